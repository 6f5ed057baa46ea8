"""Make tests/data/leaf_card.npz: cut-out and see-through cards through a thin lens, by Mitsuba 3.

Needs the bench extra, and a recent LLVM (DRJIT_LIBLLVM_PATH) for Mitsuba's vectorised variant.
"""

import math
from pathlib import Path

import mitsuba as mi
import numpy as np
from _shapes import quad_faces
from scipy.ndimage import map_coordinates

mi.set_variant("llvm_ad_rgb")

OUT = Path(__file__).parents[1] / "tests" / "data" / "leaf_card.npz"
WIDTH, HEIGHT, FIELD_OF_VIEW = 64, 48, 0.7
SAMPLES, FINE, TEXELS = 16384, 2048, 64
UV = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32)
LENSES = {"leaf": (1.5, 0.06), "wall": (4.0, 0.06), "front": (0.8, 0.04)}
BACKGROUND = 0.3


def quad(left: float, bottom: float, right: float, top: float, depth: float, slope: float = 0.0):
    corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    return np.concatenate([corners, slope * corners[:, :1] - depth], axis=1)


def leaf() -> np.ndarray:
    """Opacity [64, 64], row 0 on top: a star with soft edges."""
    y, x = (np.mgrid[:TEXELS, :TEXELS] + 0.5) / TEXELS * 2 - 1
    edge = 0.75 + 0.2 * np.sin(5 * np.arctan2(y, x)) - np.hypot(x, y)
    return (0.5 + 3 * edge).clip(0, 1).astype(np.float32)


def checker() -> list[np.ndarray]:
    """The squares of two colours, 13 pixels wide: their sides fall between samples."""
    side = 13 * 4.0 / (WIDTH / 2 / math.tan(FIELD_OF_VIEW / 2))
    edges = side * np.arange(-5, 6)
    cells = [(i, j) for i in range(10) for j in range(10)]
    return [
        np.concatenate(
            [quad(edges[i], edges[j], edges[i + 1], edges[j + 1], 4.0) for i, j in cells if (i + j) % 2 == k]
        )
        for k in (0, 1)
    ]


def surface(vertices: np.ndarray, colour: tuple[float, ...], opacity: float | np.ndarray | None):
    """An emitting mesh of quads. Mitsuba's masks leave emission alone, so that is scaled with the opacity."""
    nested = {"type": "twosided", "nested": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}}
    properties, radiance = mi.Properties(), {"type": "rgb", "value": list(colour)}
    if isinstance(opacity, np.ndarray):
        # Rows run from the top in our pictures, v from the bottom in Mitsuba's.
        mask = opacity[::-1, :, None]
        nested = {"type": "mask", "opacity": bitmap(mask), "nested": nested}
        radiance = bitmap(mask * np.asarray(colour, dtype=np.float32))
    elif opacity is not None:
        nested = {"type": "mask", "opacity": opacity, "nested": nested}
        radiance = {"type": "rgb", "value": [opacity * c for c in colour]}
    properties["bsdf"] = mi.load_dict(nested)
    properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    count = len(vertices) // 4
    faces = quad_faces(count)
    mesh = mi.Mesh("mesh", len(vertices), len(faces), has_vertex_texcoords=True, props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = vertices.astype(np.float32).ravel()
    parameters["vertex_texcoords"] = np.tile(UV, (count, 1)).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return mesh


def bitmap(picture: np.ndarray) -> dict:
    fine = picture.shape[0] == FINE
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(picture, dtype=np.float32)),
        "raw": True,
        "filter_type": "nearest" if fine else "bilinear",
    }


def main() -> None:
    alpha = leaf()
    place = (np.arange(FINE) + 0.5) / FINE * TEXELS - 0.5
    finely = map_coordinates(alpha, np.meshgrid(place, place, indexing="ij"), order=1, mode="grid-wrap")
    first, second = checker()
    shapes = {
        "wall_0": first,
        "wall_1": second,
        "leaf": quad(-0.45, -0.45, 0.35, 0.35, 1.5, slope=0.6),
        "pane": quad(0.0, -0.8, 0.9, 0.5, 2.5),
        "front": quad(-0.30, -0.1, 0.02, 0.3, 0.8),
    }
    colours = {
        "wall_0": (0.9, 0.8, 0.2),
        "wall_1": (0.05, 0.1, 0.4),
        "leaf": (0.1, 0.7, 0.15),
        "pane": (0.8, 0.1, 0.1),
        "front": (1.2, 1.2, 1.2),
    }
    opacity = {"leaf": (finely >= 0.5).astype(np.float32), "pane": 0.4, "front": 0.7 * alpha}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 20},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": BACKGROUND}},
    } | {name: surface(v, colours[name], opacity.get(name)) for name, v in shapes.items()}
    loaded = mi.load_dict(scene)
    arrays = {f"vertices_{name}": v for name, v in shapes.items()}
    arrays |= {f"colour_{name}": np.array(c) for name, c in colours.items()}
    for name, (distance, radius) in LENSES.items():
        arrays[f"lens_{name}"] = np.array([distance, radius])
        arrays[f"picture_{name}"] = picture(loaded, distance, radius).astype(np.float32)
    np.savez_compressed(OUT, alpha=alpha, background=BACKGROUND, field_of_view=FIELD_OF_VIEW, **arrays)
    print(f"{OUT.name}: {OUT.stat().st_size / 1000:.0f} kB")


def picture(loaded, distance: float, radius: float) -> np.ndarray:
    film = {
        "type": "hdrfilm",
        "width": WIDTH,
        "height": HEIGHT,
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    sensor = mi.load_dict(
        {
            "type": "thinlens",
            "fov": math.degrees(FIELD_OF_VIEW),
            "fov_axis": "x",
            "aperture_radius": radius,
            "focus_distance": distance,
            "near_clip": 1e-3,
            "far_clip": 1e4,
            "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
            "film": film,
            "sampler": {"type": "independent"},
        }
    )
    passes = [np.array(mi.render(loaded, sensor=sensor, spp=1024, seed=k)) for k in range(SAMPLES // 1024)]
    return np.mean(passes, axis=0, dtype=np.float64)


if __name__ == "__main__":
    main()
