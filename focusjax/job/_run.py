"""One run from a config to a picture: load, find the points, solve, peel, render."""

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._device import device_array
from focusjax._freed import return_freed, returned_after_compiling
from focusjax._programs import jit
from focusjax._stopwatch import Stopwatch
from focusjax.config import (
    Config,
    build_camera,
    build_focus_points,
    build_lens,
    build_look,
    build_scene,
    build_solve_options,
)
from focusjax.film import CameraSettings, ChosenSettings
from focusjax.focus import ImagePoints, Solution, SurfaceSolution
from focusjax.geometry import Camera
from focusjax.job._exposed import ExposedLens, ExposedSolution
from focusjax.job._find import control_surface, find_wishes
from focusjax.job._glass import ThroughGlass, left_to_quality, through_glass
from focusjax.job._guessed import Guessed, guessed_shares, in_grey, warn_of_holes
from focusjax.job._moving import Moving, build_moving
from focusjax.job._photograph import Photograph, take_photograph
from focusjax.job._picture import Picture, Progress, make_picture, peel_picture
from focusjax.job._solving import Settled, Settling
from focusjax.job._weigh import metered_before, weighed_depth
from focusjax.layers import Extent, disparity_map
from focusjax.lens import (
    AbstractLens,
    FocalSurface,
    FocalSurfaceLens,
    LensSettings,
    ThinLens,
    TiltShiftLens,
    at_image_distance,
    focal_surface_lens,
    lens_settings,
)
from focusjax.scene import Scene


@dataclass(frozen=True)
class Outcome:
    """Everything a run found out.

    Attributes:
        config: what was asked for.
        camera: where from.
        lens: the lens that was solved for, or the config's own when nothing was, without its aberrations and
            cat's eyes, which only the picture has. Where there is a real lens, the thin one it stands for.
        glass: the real lens, when the config has a prescription.
        points: the wishes in the picture, when there are any.
        solution: what the solve says, when there was one.
        disparity: first surface at every pixel centre in 1/m [h, w]; 0 on the background.
        blur: signed circle-of-confusion diameter in pixels [h, w] of that surface, by the real lens if there
            is one.
        picture: what rendering made, when there was any.
        photograph: what the camera made of it, when the config has an exposure or a film.
        seconds: wall-clock seconds per stage, without compiling.
        compile_seconds: seconds per stage that went into compiling.
        exposed: how focus and light share the f-number, when the config's exposure has a priority.
        guessed: how much of a photograph with depth is a guess, when its picture was traced.
        surface: the control points of a focal surface where they are in the picture, as solved.
    """

    config: Config
    camera: Camera
    lens: ThinLens | TiltShiftLens | FocalSurfaceLens
    points: ImagePoints | None
    solution: Solution | SurfaceSolution | None
    disparity: Float[np.ndarray, "h w"]
    blur: Float[np.ndarray, "h w"]
    picture: Picture | None
    photograph: Photograph | None
    seconds: dict[str, float]
    compile_seconds: dict[str, float]
    glass: ThroughGlass | None = None
    exposed: ExposedLens | ExposedSolution | None = None
    guessed: Guessed | None = None
    surface: FocalSurface | None = None

    @property
    def middle_lens(self) -> ThinLens | TiltShiftLens:
        """The lens as the middle of the picture has it."""
        return in_the_middle(self.lens, self.camera)

    @property
    def exposure(self) -> tuple[CameraSettings, ChosenSettings | None, str | None] | None:
        """What was set on the camera, how it was chosen, and what gave way; None without an exposure."""
        taken, exposed = self.photograph, self.exposed
        if taken is not None and taken.settings is not None:
            return taken.settings, taken.chosen, taken.sentence()
        return None if exposed is None else (exposed.chosen.settings, exposed.chosen, exposed.sentence())

    @property
    def settings(self) -> LensSettings:
        """Focal length, f-number and magnification there, in the config's model of close focus."""
        return lens_settings(self.camera, self.middle_lens, self.config.lens.close_focus)


def run(
    config: Config,
    *,
    solving: bool = True,
    rendering: bool = True,
    scene: Scene | None = None,
    disparity: Float[np.ndarray, "h w"] | None = None,
    like: Extent | None = None,
    spare: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Do what `config` asks for.

    Args:
        config: a checked config.
        solving: find the lens settings; otherwise the lens is taken as the config has it.
        rendering: make the picture.
        scene: what `build_scene(config)` returns, where it is at hand already.
        disparity: what `disparity_map` gives for the scene and the config's camera, where it is at hand.
        like: `Picture.extent` of another run, whose compiled programs serve again where the pictures are of
            one size; the picture is the same.
        spare: leave room in the layers of what does not move for those of other runs; see `peel`.
        progress: called with the stage that runs and the share of it that is done.

    Raises:
        ValueError: something in the config turns out impossible; one sentence says what and what to do.
    """
    report: Progress = progress if progress is not None else lambda stage, share: None
    watch = Stopwatch(on_stage=lambda stage: report(stage, None))
    camera = build_camera(config)
    with returned_after_compiling(camera.width * camera.height):
        return _run(config, camera, watch, solving, rendering, scene, disparity, like, spare)


def _run(
    config: Config,
    camera: Camera,
    watch: Stopwatch,
    solving: bool,
    rendering: bool,
    scene: Scene | None,
    disparity: Float[np.ndarray, "h w"] | None,
    like: Extent | None,
    spare: bool,
) -> Outcome:
    """As `run`; `scene` is let go where it is made here."""
    lens = build_lens(config, camera, solved=solving)
    pixels = camera.width * camera.height
    with watch.stage("load"):
        scene = build_scene(config) if scene is None else scene
        return_freed(pixels)
        moving = build_moving(config, scene)
        if moving is not None:
            # Wishes are about the instant of the picture.
            scene, camera, disparity = moving.world.at(moving.frame), moving.camera_at(moving.frame), None
        if config.lens.close_focus == "breathing" and not solving:
            camera, disparity = at_image_distance(camera, lens.focus_disparity, "breathing"), None
        wishes = build_focus_points(config, scene) if solving or config.focus else ()
        options = build_solve_options(config) if solving and config.lens.focal_surface is None else {}
    grey, exposed = None, None
    if config.weighs(solving=solving):
        with watch.stage("meter"):
            grey = metered_before(config, scene, camera)
        if "f_number" not in config.solve.free or not solving:
            assert isinstance(lens, ThinLens)
            exposed = weighed_depth(config, camera, lens, grey)
            lens = exposed.lens
    with watch.stage("locate"):
        disparity = np.asarray(disparity_map(scene, camera) if disparity is None else disparity)
        points = find_wishes(config, wishes, scene, camera, disparity) if wishes else None
        surface = control_surface(config, scene, camera, lens, disparity)
        if config.scene.photo is not None:
            warn_of_holes(config, config.focus, scene, camera)
        return_freed(pixels)
    settled = Settled(camera, lens, disparity, points, surface, exposed)
    if solving:
        settled = Settling(config, scene, wishes, options, grey, watch).settle(settled)
    elif surface is not None:
        assert isinstance(lens, ThinLens)
        settled = dataclasses.replace(settled, lens=focal_surface_lens(surface, camera, lens))
    glass = None
    if config.lens.real is not None:
        assert isinstance(settled.lens, ThinLens | TiltShiftLens)
        assert not isinstance(settled.solution, SurfaceSolution)
        with watch.stage("glass"):
            glass = through_glass(
                config, settled.camera, settled.lens, settled.solution, settled.disparity, fit=rendering
            )
    made = _Made(None, None, None, glass)
    if rendering:
        handed_over = [scene]
        # Nothing here holds on to the scene, so that it is freed once its layers are made of it.
        del scene
        made = _make(config, settled, glass, grey, handed_over, moving, like, spare, watch)
    exact = settled.lens if glass is None else glass.exact
    blur = blur_map(exact, settled.camera, device_array(settled.disparity, dtype=float))
    return Outcome(
        config=config,
        camera=settled.camera,
        lens=settled.lens,
        points=settled.points,
        solution=settled.solution,
        disparity=settled.disparity,
        blur=np.asarray(blur),
        picture=made.picture,
        photograph=made.photograph,
        seconds=watch.seconds,
        compile_seconds=watch.compile_seconds,
        glass=made.glass,
        exposed=settled.exposed,
        guessed=made.guessed,
        surface=settled.surface,
    )


@dataclass(frozen=True)
class _Made:
    """What rendering leaves; attributes as those of `Outcome`."""

    picture: Picture | None
    photograph: Photograph | None
    guessed: Guessed | None
    glass: ThroughGlass | None


def _make(
    config: Config,
    settled: Settled,
    glass: ThroughGlass | None,
    grey: float | None,
    handed_over: list[Scene],
    moving: Moving | None,
    like: Extent | None,
    spare: bool,
    watch: Stopwatch,
) -> _Made:
    """The picture, and what the camera makes of it; the scene is taken out of `handed_over`."""
    camera, lens = settled.camera, settled.lens
    scene, pixels = handed_over.pop(), camera.width * camera.height
    look = build_look(config, camera, lens) if glass is None else glass.traced
    choose = glass is not None and left_to_quality(config)
    if moving is not None:
        moving = moving.with_camera(camera, breathes=config.lens.close_focus == "breathing")
    peeled = peel_picture(config.render, scene, camera, look, like, watch, moving=moving, spare=spare)
    # Textures of a large photograph take more memory than its layers, and are of no more use.
    objects = scene.objects
    del scene
    return_freed(pixels)
    picture = make_picture(config.render, peeled, camera, look, watch, choose_lens=choose, moving=moving)
    if glass is not None and picture.lens_plan is not None:
        glass = glass.planned(picture.lens_plan)
    shares = config.scene.photo is not None and picture.method == "trace" and moving is None
    # Of the layers of a large photograph, nothing else stays.
    grey_layers = in_grey(objects, peeled.layers) if shares else None
    del peeled
    guessed = None
    if grey_layers is not None:
        return_freed(pixels)
        with watch.stage("guess"):
            guessed = guessed_shares(grey_layers, look, rays=picture.rays, seed=config.render.seed)
        del grey_layers
    photograph = None
    if config.exposure is not None or config.film is not None:
        with watch.stage("develop"):
            middle = in_the_middle(lens, camera)
            compromise = None if settled.exposed is None else settled.exposed.sentence()
            photograph = take_photograph(
                config, camera, middle, picture.image, picture.pinhole, grey=grey, weighed=compromise
            )
    return _Made(picture, photograph, guessed, glass)


def in_the_middle(
    lens: ThinLens | TiltShiftLens | FocalSurfaceLens, camera: Camera
) -> ThinLens | TiltShiftLens:
    """The lens as the middle of the picture has it."""
    return lens.thin_lens_at(camera, camera.principal_point) if isinstance(lens, FocalSurfaceLens) else lens


@jit
def blur_map(lens: AbstractLens, camera: Camera, disparity: Float[Array, "h w"]) -> Float[Array, "h w"]:
    """Signed blur diameter in pixels at every pixel centre, for the surface at `disparity` (1/m)."""

    def one(x: Array, y: Array, w: Array) -> Array:
        return lens.blur(camera, jnp.stack([x, y]).astype(w.dtype) + 0.5, w)

    columns, rows = jnp.arange(camera.width), jnp.arange(camera.height)
    across = jax.vmap(one, in_axes=(0, None, 0))
    return jax.vmap(across, in_axes=(None, 0, 0))(columns, rows, disparity)
