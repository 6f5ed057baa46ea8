"""Unlit thin-lens pictures by Mitsuba 3: the independent word on what a lens sees."""

import dataclasses
import functools
import math
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from focusjax._counts import require_counts
from focusjax.geometry import Camera
from focusjax.lens import ThinLens
from focusjax.scene import ConstantBackground, Scene

FASTEST = "llvm_ad_rgb"
"""Mitsuba's vectorised variant for CPUs; it compiles with LLVM."""
SAMPLER = "multijitter"
"""The quickest of its samplers to a given error; Kensler 2013."""
_FARTHEST = 1e5


@dataclasses.dataclass(frozen=True, eq=False)
class UnlitScene:
    """Triangles whose interpolated vertex colour is their radiance, before a constant background.

    Attributes:
        vertices: world metres [v, 3].
        faces: [t, 3].
        colours: linear radiance [v, 3].
        background: linear radiance (3).
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "t 3"]
    colours: Float[np.ndarray, "v 3"]
    background: tuple[float, float, float]


def mitsuba(variant: str = FASTEST) -> ModuleType:
    """The module, set to one of its variants.

    Raises:
        ValueError: Mitsuba is not installed, or lacks the variant or what that needs.
    """
    try:
        import mitsuba  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise ValueError(
            "the Mitsuba baseline needs Mitsuba 3, which is not installed; run `pip install mitsuba`"
        ) from error
    try:
        mitsuba.set_variant(variant)
    except ImportError as error:
        raise ValueError(
            f"Mitsuba cannot use its variant {variant} ({' '.join(str(error).split())});"
            " for an llvm variant set DRJIT_LIBLLVM_PATH to a recent LLVM"
        ) from error
    return mitsuba


def unlit_scene(scene: Scene) -> UnlitScene:
    """The triangles, vertex colours and background of `scene`.

    Raises:
        ValueError: lights, textures, material colours, opacity, or a background of several colours.
    """
    background = scene.background
    plain = (
        scene.unlit
        and isinstance(background, ConstantBackground)
        and scene.may_be_seen_through() is None
        and all(
            (m.base_colour == 1).all() and not np.any(m.emission) and m.texture < 0 for m in scene.materials
        )
    )
    if not plain:
        raise ValueError(
            "the Mitsuba baseline draws opaque, unlit, white materials with vertex colours before one"
            " background colour only; bake the scene's colours to its vertices first"
        )
    assert isinstance(background, ConstantBackground)
    red, green, blue = (float(value) for value in np.asarray(background.colour))
    return UnlitScene(scene.vertices, scene.faces, scene.colours, (red, green, blue))


def mitsuba_picture(
    scene: UnlitScene,
    camera: Camera,
    lens: ThinLens,
    *,
    samples: int,
    seed: int = 0,
    variant: str = FASTEST,
    sampler: str = SAMPLER,
) -> Float[np.ndarray, "h w 3"]:
    """What Mitsuba sees through `lens`, whose opening it takes for a disk: linear radiance.

    About one of its samples in ten million is not finite. Such samples are left out, and a pixel without any
    other is given the mean of its neighbours.

    Args:
        scene: what to see.
        camera: frame and pose; its view axis passes the middle of the frame.
        lens: where rays go; beyond 1e5 m it is focused at 1e5 m, whose blur differs by less than 0.001 px
            here.
        samples: rays per pixel, traced in passes of at most 256.
        seed: of the first pass.
        variant: of Mitsuba.
        sampler: by Mitsuba's name. "multijitter" takes as long as "independent", Mitsuba's own default, and
            comes 6 to 9 dB nearer, of 64 samples.

    Raises:
        ValueError: fewer than one sample, a camera with rise or shift, or Mitsuba cannot be used.
    """
    picture, _ = counted_mitsuba_picture(
        scene, camera, lens, samples=samples, seed=seed, variant=variant, sampler=sampler
    )
    return without_gaps(picture)


def counted_mitsuba_picture(
    scene: UnlitScene,
    camera: Camera,
    lens: ThinLens,
    *,
    samples: int,
    seed: int = 0,
    variant: str = FASTEST,
    sampler: str = SAMPLER,
) -> tuple[Float[np.ndarray, "h w 3"], int]:
    """As `mitsuba_picture`, with gaps, and how many samples were left out because they are not finite.

    A pixel of a pass that is not finite counts as one such sample: that pass is left out of the pixel's mean.
    A pixel without a finite pass is not a number. Arguments and errors are those of `mitsuba_picture`.
    """
    require_counts(samples=samples)
    x, y = (float(value) for value in camera.principal_point)
    if max(abs(x - camera.width / 2), abs(y - camera.height / 2)) > 1e-3:
        raise ValueError(
            f"the view axis passes the picture at ({x:g}, {y:g}) pixels but the Mitsuba baseline has no rise"
            " or shift; use a camera without them"
        )
    mi = mitsuba(variant)
    loaded = load_unlit(scene, variant)
    sensor = thin_lens_sensor(camera, lens, variant=variant, sampler=sampler)
    total = np.zeros((camera.height, camera.width, 3))
    weight = np.zeros((camera.height, camera.width, 1))
    dropped = done = 0
    while done < samples:
        count = min(256, samples - done)
        albedo = np.array(
            mi.render(loaded, sensor=sensor, integrator=loaded.integrator(), spp=count, seed=seed + done)
        )[..., -3:]
        if _all_finite(albedo):
            total += count * albedo
            weight += count
        else:
            finite = np.isfinite(albedo).all(axis=-1, keepdims=True)
            total += count * np.where(finite, albedo, 0.0)
            weight += count * finite
            dropped += int(np.count_nonzero(~finite))
        done += count
    mean = np.divide(total, weight, out=np.full_like(total, np.nan), where=weight > 0)
    return mean + np.asarray(scene.background), dropped


@functools.lru_cache(maxsize=2)
def load_unlit(scene: UnlitScene, variant: str = FASTEST) -> Any:
    """`scene` inside Mitsuba, which is asked for the albedo alone.

    That channel is 0 where a ray meets nothing. Colours are kept as their difference from the background,
    which is added to the picture: a pixel that a silhouette crosses then has its share of the background.
    A path integrator with an environment instead would take three times as long for the same picture.
    """
    mi = mitsuba(variant)
    bsdf = {
        "type": "twosided",
        "nested": {
            "type": "diffuse",
            "reflectance": {"type": "mesh_attribute", "name": "vertex_color"},
        },
    }
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    mesh = mi.Mesh("scene", len(scene.vertices), len(scene.faces), props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.asarray(scene.vertices, dtype=np.float32).ravel()
    parameters["faces"] = np.asarray(scene.faces, dtype=np.uint32).ravel()
    parameters.update()
    colours = np.asarray(scene.colours - np.asarray(scene.background), dtype=np.float32)
    mesh.add_attribute("vertex_color", 3, colours.ravel())
    albedo = {"type": "aov", "aovs": "albedo:albedo"}
    return mi.load_dict({"type": "scene", "integrator": albedo, "mesh": mesh})


def thin_lens_sensor(
    camera: Camera, lens: ThinLens, *, variant: str = FASTEST, sampler: str = SAMPLER
) -> Any:
    """Mitsuba's thin-lens camera with a box filter; arguments and errors are those of `mitsuba_picture`."""
    mi = mitsuba(variant)
    pose = np.asarray(camera.world_from_camera, dtype=np.float64)
    eye, backward, up = pose[:3, 3], pose[:3, 2], pose[:3, 1]
    return mi.load_dict(
        {
            "type": "thinlens",
            "fov_axis": "x",
            "near_clip": 1e-3,
            "far_clip": 1e7,
            "fov": 2 * math.degrees(math.atan(camera.width / 2 / float(camera.focal_px))),
            "aperture_radius": float(lens.aperture_radius),
            "focus_distance": min(float(lens.focus_distance()), _FARTHEST),
            "to_world": mi.ScalarTransform4f().look_at(
                origin=eye.tolist(), target=(eye - backward).tolist(), up=up.tolist()
            ),
            "film": {
                "type": "hdrfilm",
                "width": camera.width,
                "height": camera.height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": sampler},
        }
    )


def without_gaps(picture: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    """`picture` with the mean of the eight neighbours that are finite in each pixel that is not.

    Raises:
        ValueError: a pixel that is not finite has no finite neighbour.
    """
    if _all_finite(picture):
        return picture
    finite = np.asarray(np.isfinite(picture).all(axis=-1))
    out = picture.copy()
    for row, column in np.argwhere(~finite):
        around = slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2)
        sound = picture[around][finite[around]]
        if not len(sound):
            raise ValueError(
                f"pixel ({column}, {row}) and all its neighbours are not finite; expected single pixels"
                " without a finite sample, so look for vertices and colours that are not finite"
            )
        out[row, column] = sound.mean(axis=0)
    return out


def _all_finite(picture: np.ndarray) -> bool:
    """Whether every value is finite, by their sum, which takes a tenth of the time of looking at each."""
    with np.errstate(invalid="ignore"):
        return bool(np.isfinite(picture.sum(dtype=np.float64)))
