"""The whole camera as passes over one sharp view."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._counts import require_counts
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, FocalSurfaceLens, ThinLens, TiltShiftLens, in_colour
from focusjax.post._distortion import StraightenedLens, warped
from focusjax.post._gather import circle_radii
from focusjax.post._motion import motion_blur
from focusjax.post._outlines import defocused
from focusjax.post._scatter import WHITE, depths_of_light, scattered, small_lights
from focusjax.post._view import PinholeView
from focusjax.trace import light_map


def post_process(
    view: PinholeView,
    camera: Camera,
    lens: AbstractLens,
    *,
    taps: int = 32,
    motion_taps: int = 16,
    levels: int | None = None,
) -> Float[Array, "h w 3"]:
    """The picture through a lens, made of one sharp view (Kyaw 2013 section 7.3), linear as `render`'s.

    Passes, in their order, each left out where there is nothing for it to do:

    1. motion blur along the view's velocities (`motion_blur`);
    2. defocus: every pixel averages the view where its lens rays pass at its own depth (`gather`), or, beside
       blurred foregrounds, what its rays hit (`_outlines`), and what small lights out of focus have beyond
       white is sent where the lens sends it (`_scatter`), all with the shape of the opening, spherical
       aberration, coma, astigmatism and curvature of field; for each colour, where the lens treats them
       differently;
    3. distortion and lateral colour, by resampling (`warped`);
    4. vignetting, as light that is lost from the corners (`light_map`).

    `photograph` exposes and develops it like any other picture. What the view does not see is made up: what
    shows through the outline of a blurred foreground continues what is beside it, as the frame's edge goes on
    beyond it. Small lights end where a foreground in front of them is sharp, and cat's eyes darken the
    corners without being seen.

    Args:
        view: what a pinhole sees.
        camera: the frame.
        lens: any lens; its rays are looked at without a scene.
        taps: places that each pixel looks at for its defocus.
        motion_taps: the same for motion.
        levels: of mip maps, as in `gather`; a number lets lenses that move share one compiled program.

    Raises:
        ValueError: a view of another size than the camera's, values that are not finite, or no taps.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> scene = fj.make_scene([wall], unlit=True)
        >>> from focusjax.post import post_process, view_in_layers
        >>> view = view_in_layers(fj.peel(scene, camera, lens), scene)
        >>> post_process(view, camera, lens, taps=16).round(3)[3, 4].tolist()
        [0.8, 0.8, 0.8]
    """
    require_counts(taps=taps, motion_taps=motion_taps)
    image = view.image
    if view.velocity is not None:
        image = motion_blur(image, view.disparity, view.velocity, taps=motion_taps)
    # Their rays meet where a pinhole's picture is, and all of them pass.
    ideal = isinstance(lens, ThinLens | TiltShiftLens | FocalSurfaceLens)
    opened = float(lens.parallax(camera)) > 0

    def through(one: AbstractLens) -> Float[Array, "h w 3"]:
        found = image
        if opened:
            straight = one if ideal else StraightenedLens(one)
            found, lights = _without_lights(found, view.disparity, camera, straight)
            found = defocused(found, view.disparity, camera, straight, taps=taps, levels=levels)
            if lights is not None:
                excess, origin, radius = lights
                depths = np.asarray(view.disparity)
                found = found + scattered(excess, origin, depths, camera, straight, radius=radius, taps=taps)
        return found if ideal else warped(found, camera, one)

    found = in_colour(through, lens)
    return found if ideal else found * light_map(lens, camera).share.reshape(found.shape).astype(found.dtype)


def _without_lights(
    image: Float[Array, "h w 3"], disparity: Float[Array, "h w"], camera: Camera, lens: AbstractLens
) -> tuple[Float[Array, "h w 3"], tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"], float] | None]:
    """The view without what small lights out of focus have beyond white.

    Then that, its disparities, and the radius in pixels over which it is spread at most; None without any.
    """
    picture = np.asarray(image)
    if not picture.max(initial=0.0) > WHITE:
        return image, None
    origin = depths_of_light(picture, np.asarray(disparity))
    reach = np.asarray(circle_radii(jnp.asarray(origin, dtype=image.dtype), camera, lens))
    chosen = small_lights(picture, reach)
    if not chosen.any():
        return image, None
    lights = np.where(chosen[..., None], np.maximum(picture - WHITE, 0.0), 0.0)
    return jnp.asarray(picture - lights), (lights, origin, float(reach[chosen].max()))
