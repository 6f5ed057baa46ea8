"""The tilt-shift lens: a thin lens whose axis is turned against the sensor's normal.

Axes are the camera's, X right, Y up, Z forward along the sensor's normal, in metres from the lens
centre. A thin lens of focal length F with unit axis u images P to P' = -P F / (u.P - F), since the lens
equation holds along its axis and the ray through its centre is straight. P' falls on the sensor, at
Z = -s, just when

    n.P = 1,        n = u / F - e_z / s,                                       (Scheimpflug)

so one plane is sharp. A film point looks along (x, y, 1) and meets it at the disparity

    w_f(x, y) = n_z + n_x x + n_y y,

which is affine. Where Z = 0 the plane passes the line u.P = F, whatever s is: focusing turns the plane
about that hinge, at distance J = F / sin(angle between u and e_z) from the lens centre (Merklinger,
Focusing the View Camera, 1993). Conversely n gives the lens: u_x = F n_x, u_y = F n_y, 1 / s = u_z / F - n_z.

The opening turns with the lens. A pupil point Q in the plane u.Q = 0 sees the sharp point
(x, y, 1) / w_f along a ray that crosses Z = 0 at

    C = (Q_xy - Q_z (x, y)) / (1 - Q_z w_f),

which is all that image space needs: b = f C, a = p - b w_f. To first order in the angle t, an opening
that stays upright (C = Q_xy) differs by E sin(t) (x, y) and by E^2 sin(t) w_f: the blur spot is as
wide as the thin lens's along the hinge, and has (u_x x + u_y y + u_z) times its area. The plane in focus is
the same.
"""

from typing import SupportsFloat

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._arguments import real_number
from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture, Disk
from focusjax.lens._base import AbstractLens, frame_corners
from focusjax.lens._length import length, root
from focusjax.lens._scheimpflug import (
    MAX_TILT,
    Movements,
    check_plane,
    lens_axis,
    movements_of,
    plane_of,
    view_tangents,
)
from focusjax.lens._thin import ThinLens, thin_lens

_LEAST_GAP = 0.1
"""Share of its distance by which a sharp point stays clear of the turned opening (1 - Q_z w_f at least)."""


class TiltShiftLens(AbstractLens):
    """An ideal lens focused on any plane n.P = 1 that misses the lens centre.

    `ThinLens` is the case n = (0, 0, 1 / focus distance). As there, the picture does not breathe: the
    camera's focal length is both the lens's and the distance that scales the picture. Shift and rise are
    the camera's (`make_camera`), since they move the frame and leave all rays as they are.

    No lens of focal length F reaches a plane with F |(n_x, n_y)| >= 1, whose hinge is nearer than F; here
    such a plane is taken with the opening edge-on. `tilt_shift_lens` and `lens_for_plane` refuse it.

    Attributes:
        plane: n [3] in 1/m, in camera axes (X right, Y up, Z forward).
        aperture_radius: radius E in metres of the circle around the opening; 0 is a pinhole.
        aperture: shape of the opening.

    Example:
        >>> lens = tilt_shift_lens(focus_distance=2.0, tilt=0.1, f_number=2.8, focal_length=0.09)
        >>> [round(float(v), 4) for v in lens.plane]
        [0.0, -1.1093, 0.5]
    """

    plane: Float[Array, "3"]
    aperture_radius: Float[Array, ""]
    aperture: AbstractAperture = eqx.field(default_factory=Disk)

    def opening(self) -> AbstractAperture:
        return self.aperture

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        tangents = view_tangents(camera, film_point)
        focus = self.plane[2] + self.plane[:2] @ tangents
        axis = lens_axis(self.plane, camera.focal_length)
        # The pupil turned by the smallest rotation that takes e_z to the lens axis.
        upright = pupil_point * jnp.array([1.0, -1.0], dtype=pupil_point.dtype)
        lean = axis[:2] @ upright
        across = self.aperture_radius * (upright - axis[:2] * lean / (1.0 + axis[2]))
        ahead = -self.aperture_radius * lean
        crossing = (across - ahead * tangents) / jnp.maximum(1.0 - ahead * focus, _LEAST_GAP)
        b = camera.focal_px * crossing * jnp.array([1.0, -1.0], dtype=crossing.dtype)
        return LensRay(a=film_point - b * focus, b=b, weight=jnp.ones_like(focus))

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Signed diameter in pixels, 2 f E (w_f - w): that of the blur spot along the hinge line.

        Across it the spot is wider or narrower by u_x x + u_y y + u_z, which is cos t on the view axis.
        """
        span = 2.0 * camera.focal_px * self.aperture_radius
        return span * (self.focal_disparity(camera, film_point) - disparity)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        # A product of three factors that are convex in the film point. Where one rises as another falls it
        # may top a pixel's corners, by about E sin(t)^2 / (4 F f), or 1e-5 pixels.
        focus = self.focal_disparity(camera, film_point)
        widest = self._stretch(camera, view_tangents(camera, film_point)) * self._gap(camera, focus)
        return film_point, camera.focal_px * self.aperture_radius * widest * jnp.abs(focus - disparity)

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        # Affine, so its size is largest in a corner of the frame.
        corners = frame_corners(camera, self.plane.dtype)
        focus = jax.vmap(lambda corner: self.focal_disparity(camera, corner))(corners)
        return self.parallax(camera) * jnp.max(jnp.abs(focus - disparity))

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        # Both factors are convex in the film point, so they are largest in a corner of the frame.
        corners = frame_corners(camera, self.plane.dtype)
        stretch = jax.vmap(lambda corner: self._stretch(camera, view_tangents(camera, corner)))(corners)
        gap = jax.vmap(lambda corner: self._gap(camera, self.focal_disparity(camera, corner)))(corners)
        return camera.focal_px * self.aperture_radius * jnp.max(stretch) * jnp.max(gap)

    def focal_disparity(self, camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, ""]:
        """Disparity w_f in 1/m that is sharp at `film_point`; not positive where nothing ahead is."""
        return self.plane[2] + self.plane[:2] @ view_tangents(camera, film_point)

    @property
    def focus_disparity(self) -> Float[Array, ""]:
        """Disparity in 1/m at which the view axis meets the plane in focus; 0 if they are parallel."""
        return self.plane[2]

    def focus_distance(self) -> Float[Array, ""]:
        """Distance in metres along the view axis; negative when the plane meets it behind the lens."""
        return 1.0 / self.plane[2]

    def f_number(self, camera: Camera) -> Float[Array, ""]:
        """Focal length over aperture diameter; infinite for a pinhole."""
        return camera.focal_length / (2.0 * self.aperture_radius)

    def movements(self, camera: Camera) -> Movements:
        """Tilt, swing, image distance and hinge that focus on this plane."""
        return movements_of(self.plane, camera.focal_length)

    def _stretch(self, camera: Camera, tangents: Float[Array, "2"]) -> Float[Array, ""]:
        """Largest |Q_xy - Q_z (x, y)| of a rim point Q, over E.

        It is the root of the larger eigenvalue of 1 + d d' - g g', with d = (x, y) and g = u_xy - u_z d.
        """
        axis = lens_axis(self.plane, camera.focal_length)
        seen = axis[:2] - axis[2] * tangents
        trace = tangents @ tangents - seen @ seen
        cross = tangents[0] * axis[1] - tangents[1] * axis[0]
        square = trace**2 + 4.0 * cross**2
        # Upright, both are 0, where the root has no slope.
        return jnp.sqrt(1.0 + (trace + root(square)) / 2.0)

    def _gap(self, camera: Camera, focus: Float[Array, ""]) -> Float[Array, ""]:
        """Largest 1 / (1 - Q_z w_f) over the opening."""
        axis = lens_axis(self.plane, camera.focal_length)
        depth = self.aperture_radius * length(axis[:2]) * jnp.abs(focus)
        return 1.0 / jnp.maximum(1.0 - depth, _LEAST_GAP)


def tilt_shift_lens(
    *,
    focus_distance: SupportsFloat,
    focal_length: SupportsFloat,
    tilt: SupportsFloat = 0.0,
    swing: SupportsFloat = 0.0,
    f_number: SupportsFloat | None = None,
    aperture_radius: SupportsFloat | None = None,
    aperture: AbstractAperture | None = None,
    max_tilt: SupportsFloat = MAX_TILT,
) -> TiltShiftLens:
    """A `TiltShiftLens` in a photographer's terms, with checked values.

    Args:
        focus_distance: metres along the view axis (the sensor's normal); `inf` is allowed, and makes the
            plane in focus parallel to the view axis when the lens is tilted.
        focal_length: metres.
        tilt: radians; positive leans the lens forward, its axis down, so that the plane in focus passes
            below the lens, at J = F / sin(tilt), and leans back above it, as for a ground plane.
        swing: radians; positive turns the lens's axis to the right, and the hinge is to the right.
        f_number: focal length over aperture diameter; give this or `aperture_radius`.
        aperture_radius: metres; 0 is a pinhole.
        aperture: shape of the opening; a disk when not given.
        max_tilt: radians; the most that the lens's axis may turn from the sensor's normal.

    Raises:
        ValueError: as `thin_lens`, and for a tilt over the limit or a plane that the lens cannot reach.

    Example:
        Tilted by arcsin(0.09 / 1.5), the lens has its plane in focus pass 1.5 m below it, as the ground does.

        >>> lens = fj.tilt_shift_lens(
        ...     focus_distance=float("inf"), tilt=np.arcsin(0.06), f_number=4, focal_length=0.09
        ... )
        >>> camera = fj.look_at((0, 1.5, 0), (0, 1.5, -1), width=60, height=40, focal_length=0.09)
        >>> film_point, disparity = camera.project(jnp.array([0.0, 0.0, -10.0]))
        >>> round(abs(float(lens.blur(camera, film_point, disparity))), 6)
        0.0
    """
    upright = thin_lens(
        focus_distance=focus_distance,
        focal_length=focal_length,
        f_number=f_number,
        aperture_radius=aperture_radius,
        aperture=aperture,
    )
    angles = (
        real_number(angle, f"{name} in radians", "an angle between -pi/2 and pi/2")
        for name, angle in (("tilt", tilt), ("swing", swing))
    )
    plane = plane_of(float(focus_distance), float(focal_length), *angles)
    check_plane(plane, float(focal_length), max_tilt)
    return TiltShiftLens(jnp.asarray(plane, dtype=float), upright.aperture_radius, upright.aperture)


def lens_for_plane(
    plane: Float[Array, "3"],
    camera: Camera,
    *,
    f_number: SupportsFloat | None = None,
    aperture_radius: SupportsFloat | None = None,
    aperture: AbstractAperture | None = None,
    max_tilt: SupportsFloat = MAX_TILT,
) -> TiltShiftLens:
    """The `TiltShiftLens` of the camera's focal length that is focused on `plane`, checked.

    Args:
        plane: n [3] in 1/m, in camera axes (`focal_plane_through` makes one).
        camera: whose focal length the lens has, and in whose frame the plane has to show.
        f_number: focal length over aperture diameter; give this or `aperture_radius`.
        aperture_radius: metres; 0 is a pinhole.
        aperture: shape of the opening; a disk when not given.
        max_tilt: radians; the most that the lens's axis may turn from the sensor's normal.

    Raises:
        ValueError: a plane that is nowhere ahead of the lens inside the frame, one that takes more tilt than
            `max_tilt` or that no lens of this focal length reaches, as those near the lens centre; or an
            opening out of range.
    """
    length = float(camera.focal_length)
    opening = thin_lens(
        focus_distance=float("inf"),
        focal_length=length,
        f_number=f_number,
        aperture_radius=aperture_radius,
        aperture=aperture,
    )
    check_plane(plane, length, max_tilt)
    lens = TiltShiftLens(jnp.asarray(plane, dtype=float), opening.aperture_radius, opening.aperture)
    corners = frame_corners(camera, lens.plane.dtype)
    nearest = float(jax.vmap(lambda corner: lens.focal_disparity(camera, corner))(corners).max())
    if nearest < 0:
        raise ValueError(
            f"the plane {[float(v) for v in lens.plane]} 1/m is behind the lens all over the frame, so that"
            " nothing in the picture is sharp; choose a plane that shows, or move the camera"
        )
    return lens


def as_tilt_shift(lens: ThinLens | TiltShiftLens) -> TiltShiftLens:
    """The same lens with its focus as a plane; differentiable."""
    if isinstance(lens, TiltShiftLens):
        return lens
    focus = lens.focus_disparity
    plane = jnp.stack([jnp.zeros_like(focus), jnp.zeros_like(focus), focus])
    return TiltShiftLens(plane, lens.aperture_radius, lens.aperture)
