"""What all methods are given: the same triangles, camera and lens, in a form that every one understands."""

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax import job
from focusjax._programs import jit
from focusjax.config import Config, ConfigError, build_camera, build_lens, build_scene, refuse_close_focus
from focusjax.geometry import Camera, make_camera
from focusjax.lens import Disk, ThinLens, thin_lens
from focusjax.scene import ConstantBackground, Scene, Shader, constant_background, make_object, make_scene

SKY = (0.35, 0.45, 0.62)
"""Radiance behind the triangles."""


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """A picture to make.

    Attributes:
        name: what to call it, and part of file names.
        title: the same for people.
        scene: opaque, unlit triangles with vertex colours before one background colour.
        camera: frame and pose.
        lens: thin, with a disk for an opening.
        max_layers: most layers that a method may peel.
    """

    name: str
    title: str
    scene: Scene
    camera: Camera
    lens: ThinLens
    max_layers: int

    def arrays(self) -> dict[str, np.ndarray]:
        """All that makes the picture."""
        background = self.scene.background
        assert isinstance(background, ConstantBackground)
        return {
            "vertices": self.scene.vertices,
            "faces": self.scene.faces,
            "colours": self.scene.colours,
            "background": np.asarray(background.colour),
            "world_from_camera": np.asarray(self.camera.world_from_camera),
            "focal_length": np.asarray(self.camera.focal_length),
            "sensor_width": np.asarray(self.camera.sensor_width),
            "size": np.array([self.camera.width, self.camera.height]),
            "focus_distance": np.asarray(self.lens.focus_distance()),
            "aperture_radius": np.asarray(self.lens.aperture_radius),
        }

    def digest(self) -> str:
        """A word that differs for every other picture."""
        out = hashlib.sha256()
        for name, array in self.arrays().items():
            kept = array.astype(np.float32) if array.dtype.kind == "f" else array.astype(np.int64)
            out.update(f"{name} {kept.shape}".encode() + kept.tobytes())
        return out.hexdigest()[:24]

    def save(self, file: Path) -> None:
        """Write everything to a file that `load_case` reads."""
        arrays: dict[str, Any] = self.arrays()
        np.savez(file, name=self.name, title=self.title, max_layers=self.max_layers, **arrays)


def load_case(file: Path) -> Case:
    """What `Case.save` wrote."""
    with np.load(file) as kept:
        scene = _plain_scene(kept["vertices"], kept["faces"], kept["colours"], kept["background"])
        width, height = (int(value) for value in kept["size"])
        camera = make_camera(
            kept["world_from_camera"],
            width=width,
            height=height,
            focal_length=float(kept["focal_length"]),
            sensor_width=float(kept["sensor_width"]),
        )
        lens = thin_lens(
            focus_distance=float(kept["focus_distance"]), aperture_radius=float(kept["aperture_radius"])
        )
        name, title, layers = str(kept["name"]), str(kept["title"]), int(kept["max_layers"])
    return Case(name, title, scene, camera, lens, layers)


def case_from_config(config: Config, size: tuple[int, int] | None = None) -> Case:
    """The scene of `config` through the lens that its wishes ask for, or its own where it has none.

    The scene is `baked` and the lens has a disk for an opening, so that lens and visibility are all that is
    compared.

    Args:
        config: a checked config.
        size: width and height in pixels of the picture, instead of the config's, over the same field.

    Raises:
        ConfigError: surfaces that may be seen through, a lens that is turned or slid, or a focal surface,
            which not every method understands.
        ValueError: as for a run of the config.
    """
    _check_lens(config)
    refuse_close_focus(config, "a comparison of methods")
    scene = build_scene(config)
    if scene.may_be_seen_through() is not None:
        raise ConfigError(
            f"{config.source}: the scene has surfaces that may be seen through, which not every method"
            " understands; give these objects opacity = 1"
        )
    if config.focus:
        outcome = job.run(config, rendering=False)
        camera, lens = outcome.camera, outcome.lens
    else:
        camera = build_camera(config)
        lens = build_lens(config, camera, solved=False)
    assert isinstance(lens, ThinLens)
    if size is not None:
        camera = resized(camera, *size)
    name = config.source.stem
    return Case(
        name=name,
        title=config.title or name.replace("_", " ").capitalize(),
        scene=baked(scene),
        camera=camera,
        lens=dataclasses.replace(lens, aperture=Disk()),
        max_layers=config.render.max_layers,
    )


def _check_lens(config: Config) -> None:
    """Refuse what is more than a thin lens before the middle of the frame."""
    camera, lens = config.camera, config.lens
    settings = {
        "lens.tilt_deg": lens.tilt_deg,
        "lens.swing_deg": lens.swing_deg,
        "camera.rise_mm": camera.rise_mm,
        "camera.shift_mm": camera.shift_mm,
        "lens.focal_surface": lens.focal_surface is not None,
        **{f"lens.{key}": True for key in lens.look},
    }
    for key, value in settings.items():
        if value:
            raise ConfigError(
                f"{config.source}: the config has {key}, which not every method understands; leave it out"
            )


def baked(scene: Scene) -> Scene:
    """The same triangles with their unlit colour at the vertices, at most white, under a plain sky."""
    shader = dataclasses.replace(scene, unlit=True).shader(np.zeros(3))
    corner = np.zeros(len(scene.vertices), dtype=np.int32)
    face = np.zeros(len(scene.vertices), dtype=np.int32)
    for number in range(3):
        face[scene.faces[:, number]] = np.arange(len(scene.faces))
        corner[scene.faces[:, number]] = number
    weights = jnp.asarray(np.eye(3)[corner], dtype=float)
    extent = jnp.full(len(corner), 1e-3)
    colours = _shaded(shader, jnp.asarray(face), weights, extent)
    white = np.minimum(np.asarray(colours, dtype=np.float64), 1.0)
    return _plain_scene(scene.vertices, scene.faces, white, np.array(SKY))


@jit
def _shaded(
    shader: Shader, face: Int[Array, " v"], weights: Float[Array, "v 3"], extent: Float[Array, " v"]
) -> Float[Array, "v 3"]:
    return jax.vmap(shader)(face, weights, extent)


def resized(camera: Camera, width: int, height: int) -> Camera:
    """The same view at `width` x `height` pixels."""
    now, then = np.array([camera.width, camera.height]), np.array([width, height])
    off = (np.asarray(camera.principal_point) - now / 2) * width / camera.width
    centre = jnp.asarray(then / 2 + off, dtype=camera.principal_point.dtype)
    return dataclasses.replace(camera, width=width, height=height, principal_point=centre)


def _plain_scene(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, sky: np.ndarray) -> Scene:
    surface = make_object("all", vertices, faces, vertex_colours=colours)
    return make_scene([surface], background=constant_background(sky), unlit=True)
