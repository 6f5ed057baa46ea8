"""A mirroring ball under a panorama through a thin lens, by view-dependent layers and by Mitsuba.

Mitsuba's perfect conductor is the independent word on what each lens ray sees mirrored. Needs
`pip install -e '.[bench]'`.

    python scripts/compare_mirror.py --samples 512
"""

import jax.numpy as jnp
import numpy as np
import trimesh
from _command_line import make_parser

from focusjax.baselines import mitsuba, thin_lens_sensor
from focusjax.geometry import Camera, look_at
from focusjax.layers import peel
from focusjax.lens import ThinLens
from focusjax.metrics import psnr, ssim
from focusjax.scene import ImageBackground, Scene, make_object, make_scene
from focusjax.trace import render

REFLECTANCE = 0.8
FIELD = 0.6


def panorama(height: int = 256) -> np.ndarray:
    """Surroundings [h, 2 h, 3] of smooth waves and two soft lamps."""
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    azimuth = ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5) * 2 * np.pi
    azimuth, elevation = np.meshgrid(azimuth, elevation)
    x, y, z = np.cos(elevation) * np.sin(azimuth), np.sin(elevation), -np.cos(elevation) * np.cos(azimuth)
    waves = np.stack([np.sin(9 * x + 1), np.sin(8 * y + 2 * x), np.sin(7 * z - 3 * y)], axis=-1)
    lamps = [
        np.exp(60 * (np.stack([x, y, z], -1) @ np.array(d) - 1))
        for d in ((0.5, 0.6, 0.6245), (-0.6, 0.0, 0.8))
    ]
    return 0.3 + 0.2 * waves + 1.5 * sum(lamps)[..., None]


def by_mitsuba(scene: Scene, camera: Camera, lens: ThinLens, pixels: np.ndarray, samples: int) -> np.ndarray:
    mi = mitsuba()
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(
        {
            "type": "twosided",
            "nested": {
                "type": "conductor",
                "material": "none",
                "specular_reflectance": {"type": "rgb", "value": REFLECTANCE},
            },
        }
    )
    mesh = mi.Mesh("ball", len(scene.vertices), len(scene.faces), has_vertex_normals=True, props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.asarray(scene.vertices, dtype=np.float32).ravel()
    parameters["vertex_normals"] = np.asarray(scene.normals, dtype=np.float32).ravel()
    parameters["faces"] = np.asarray(scene.faces, dtype=np.uint32).ravel()
    parameters.update()
    # The middle of our panorama is seen along -z, that of Mitsuba's along +z.
    turned = np.roll(pixels, pixels.shape[1] // 2, axis=1).astype(np.float32)
    loaded = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "surroundings": {"type": "envmap", "bitmap": mi.Bitmap(turned)},
            "ball": mesh,
        }
    )
    sensor = thin_lens_sensor(camera, lens)
    return np.array(mi.render(loaded, sensor=sensor, spp=samples)).astype(np.float64)


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--size", nargs=2, type=int, default=[96, 72], help="width and height in pixels")
    parser.add_argument("--samples", type=int, default=576, help="Mitsuba's rays per pixel")
    parser.add_argument("--rays", type=int, default=128)
    parser.add_argument("--focus", nargs="+", type=float, default=[0.6, 0.8, 2.0], help="metres")
    options = parser.parse_args()
    width, height = options.size
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.22)
    ball = make_object(
        "ball",
        mesh.vertices,
        mesh.faces,
        colour=(0, 0, 0),
        reflectance=REFLECTANCE,
        translate=(0.03, 0.02, -1.0),
    )
    pixels = panorama()
    scene = make_scene([ball], background=ImageBackground(jnp.asarray(pixels, dtype=float), jnp.asarray(0.0)))
    camera = look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), width=width, height=height, field_of_view=FIELD)
    # Mitsuba is independent of how focusjax takes a field of view.
    assert np.isclose(2 * np.arctan(width / 2 / float(camera.focal_px)), FIELD)
    for distance in options.focus:
        lens = ThinLens(jnp.asarray(1 / distance), jnp.asarray(0.08))
        reference = by_mitsuba(scene, camera, lens, pixels, options.samples)
        for view_dependent in (False, True):
            layers = peel(scene, camera, lens, view_dependent=view_dependent)
            picture = np.asarray(render(layers, lens, rays=options.rays))
            kind = "view-dependent" if view_dependent else "baked"
            print(
                f"focus {distance:g} m, {kind:14}: {psnr(picture, reference):.1f} dB,"
                f" SSIM {ssim(picture, reference):.4f}"
            )


if __name__ == "__main__":
    main()
