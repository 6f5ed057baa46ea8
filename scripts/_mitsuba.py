"""Unlit thin-lens pictures by Mitsuba 3: the independent word on what a lens sees."""

import dataclasses
import functools
import math

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class UnlitScene:
    """Triangles whose interpolated vertex colour is their radiance, before a constant background.

    Attributes:
        vertices: world metres [v, 3].
        faces: [t, 3].
        colours: linear radiance [v, 3].
        background: linear radiance (3).
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray
    background: tuple[float, float, float]


@functools.cache
def mitsuba():
    """The module, set to its vectorised CPU variant."""
    import mitsuba

    mitsuba.set_variant("llvm_ad_rgb")
    return mitsuba


@functools.lru_cache(maxsize=2)
def load(scene: UnlitScene):
    """`scene` inside Mitsuba: the albedo channel carries the colours, the environment the background."""
    mi = mitsuba()
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
    mesh.add_attribute("vertex_color", 3, np.asarray(scene.colours, dtype=np.float32).ravel())
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {
                "type": "aov",
                "aovs": "albedo:albedo",
                "sky": {"type": "path", "max_depth": 1},
            },
            "environment": {
                "type": "constant",
                "radiance": {"type": "rgb", "value": list(scene.background)},
            },
            "mesh": mesh,
        }
    )


def render_thin_lens(
    scene: UnlitScene,
    world_from_camera: np.ndarray,
    width: int,
    height: int,
    field_of_view: float,
    aperture_radius: float,
    focus_distance: float,
    samples: int,
    seed: int = 0,
) -> np.ndarray:
    """Linear picture [height, width, 3], one-pixel box filter.

    Args:
        scene: what to see.
        world_from_camera: pose [4, 4], looking along -z with +y up.
        width: pixels.
        height: pixels.
        field_of_view: horizontal, degrees.
        aperture_radius: metres.
        focus_distance: metres; infinity becomes 1e5 m, whose blur differs by less than 0.001 px here.
        samples: rays per pixel, traced in passes of at most 256.
        seed: first pass's seed.
    """
    mi = mitsuba()
    loaded = load(scene)
    pose = np.asarray(world_from_camera, dtype=np.float64)
    eye, backward, up = pose[:3, 3], pose[:3, 2], pose[:3, 1]
    sensor = mi.load_dict(
        {
            "type": "thinlens",
            "fov": field_of_view,
            "fov_axis": "x",
            "near_clip": 1e-3,
            "far_clip": 1e7,
            "aperture_radius": aperture_radius,
            "focus_distance": focus_distance if math.isfinite(focus_distance) else 1e5,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=eye.tolist(), target=(eye - backward).tolist(), up=up.tolist()
            ),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        }
    )
    total = np.zeros((height, width, 3))
    done = 0
    while done < samples:
        count = min(256, samples - done)
        channels = np.array(
            mi.render(loaded, sensor=sensor, integrator=loaded.integrator(), spp=count, seed=seed + done)
        )
        total += count * (channels[..., :3] + channels[..., -3:]).astype(np.float64)
        done += count
    return total / samples
