"""Where the wishes and control points of a config are in its picture."""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float

from focusjax._arguments import require_kind, require_known
from focusjax.config import Config, build_control_points, build_focal_surface, refusals_located
from focusjax.focus import FocusPoint, ImagePoints, locate
from focusjax.geometry import Camera
from focusjax.layers import disparity_map
from focusjax.lens import AbstractLens, FocalSurface, ThinLens
from focusjax.scene import Scene


def find_points(
    wishes: Sequence[FocusPoint],
    scene: Scene,
    camera: Camera,
    *,
    disparity: Float[np.ndarray, "h w"] | None = None,
    favour_near: float = 0.0,
) -> ImagePoints:
    """Where each of the `wishes` is in the picture of `scene`, and how far away.

    Args:
        wishes: at least one.
        scene: what they are about.
        camera: the pinhole that frames the picture.
        disparity: what `disparity_map` gives for them, when it is at hand already.
        favour_near: how much more near wishes count (see `locate`).

    The numbers of wishes may be traced by `jax.jit` and `jax.grad` (see `locate`), and `solve` is
    differentiable in what is found; scene and camera have to be known.

    Raises:
        ArgumentError: as `locate`; a scene that is none.

    Example:
        >>> card = fj.make_object("card", [(-0.5, -0.4, -2), (0.5, -0.4, -2), (0, 0.4, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> centre = fj.FocusPoint(fj.AtPixel(4.5, 3.5), fj.Sharp())
        >>> corner = fj.FocusPoint(fj.AtPixel(0.5, 0.5), fj.Blur(3))
        >>> fj.find_points([centre, corner], fj.make_scene([card]), camera).disparity.round(6).tolist()
        [0.5, 0.0]
    """
    usage = "find_points(wishes, scene, camera)"
    require_kind(scene, Scene, usage, "`make_scene` makes one", "scene")
    require_kind(camera, Camera, usage, "`look_at` and `make_camera` make one", "camera")
    if disparity is None:
        remedy = "it decides what shows; locate the wishes before, and trace the points that are found"
        require_known(camera, usage, remedy, "camera")
        with jax.ensure_compile_time_eval():
            disparity = disparity_map(scene, camera)
    return locate(
        wishes,
        camera,
        vertices=scene.vertices,
        faces=scene.faces,
        objects=scene.objects,
        disparity_map=disparity,
        favour_near=favour_near,
    )


def find_wishes(
    config: Config,
    wishes: Sequence[FocusPoint],
    scene: Scene,
    camera: Camera,
    disparity: Float[np.ndarray, "h w"],
) -> ImagePoints:
    """The wishes of a config in its picture; the error for one that cannot be found names its key."""
    with refusals_located(config):
        return find_points(wishes, scene, camera, disparity=disparity, favour_near=config.solve.favour_near)


def control_surface(
    config: Config, scene: Scene, camera: Camera, lens: AbstractLens, disparity: Float[np.ndarray, "h w"]
) -> FocalSurface | None:
    """The config's focal surface, through its control points where they are in the picture."""
    table = config.lens.focal_surface
    if table is None:
        return None
    assert isinstance(lens, ThinLens)
    controls = build_control_points(config, scene)
    with refusals_located(config, "lens.focal_surface.points"):
        found = find_points(controls, scene, camera, disparity=disparity, favour_near=table.favour_near)
    return build_focal_surface(config, found, camera, lens)
