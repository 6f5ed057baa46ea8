"""The whole camera as passes over one sharp view."""

from jaxtyping import Array, Float

from focusjax._counts import require_counts
from focusjax.baselines import gather
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, FocalSurfaceLens, ThinLens, TiltShiftLens, in_colour
from focusjax.post._motion import motion_blur
from focusjax.post._straight import StraightenedLens
from focusjax.post._view import PinholeView
from focusjax.post._warp import warped
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
    2. defocus: every pixel averages the view where its lens rays pass at its own depth (`gather`), with the
       shape of the opening, spherical aberration, coma, astigmatism and curvature of field; for each colour,
       where the lens treats them differently;
    3. distortion and lateral colour, by resampling (`warped`);
    4. vignetting, as light that is lost from the corners (`light_map`).

    `photograph` exposes and develops it like any other picture. What the view does not see is nowhere:
    blurred foregrounds end where they are sharp and hide what is behind them, the frame's edge goes on
    beyond it, and cat's eyes darken the corners without being seen.

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
        >>> view = view_in_layers(layers, scene)  # doctest: +SKIP
        >>> image = post_process(view, camera, lens, taps=32)  # doctest: +SKIP
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
            found = gather(found, view.disparity, camera, straight, taps=taps, levels=levels)
        return found if ideal else warped(found, camera, one)

    found = in_colour(through, lens)
    return found if ideal else found * light_map(lens, camera).share.reshape(found.shape).astype(found.dtype)
