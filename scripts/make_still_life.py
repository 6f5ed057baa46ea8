"""Generate the objects of the still life: python scripts/make_still_life.py [FOLDER].

Everything is made here from formulas and seeded noise, and given to the public domain (CC0).
Units are metres and y is up; every object stands on y = 0, on the axis x = z = 0.
"""

import argparse
import io
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from scipy.interpolate import PchipInterpolator

SECTIONS = 48

# Outlines of turned things from the middle of the foot to the inside of the mouth, in millimetres:
# radius, height.
VASE = (
    *((0, 0), (30, 0), (34, 4), (52, 50), (56, 85), (40, 140), (20, 180), (19, 205)),
    *((27, 222), (25, 223), (16, 205), (16, 170), (0, 165)),
)
JUG = (
    *((0, 0), (40, 0), (60, 20), (70, 55), (60, 90), (36, 112), (34, 122)),
    *((42, 134), (39, 134), (31, 122), (31, 110), (0, 100)),
)
CANDLE = ((0, 0), (34, 0), (34, 6), (12, 11), (11, 20), (11.5, 150), (9, 153), (0, 152))
FLAME = ((0, 0), (4.5, 4), (5.8, 11), (3.5, 24), (0, 36))
LAMP_FOOT = ((0, 0), (50, 0), (50, 10), (12, 20), (10, 160), (20, 180), (0, 185))
PAWN = (
    *((0, 0), (16.5, 0), (16.5, 4), (13, 9), (7.5, 20), (6, 30), (10, 32.5), (6.5, 35)),
    *((9.5, 40), (10, 43.5), (8, 49.5), (4.5, 52.8), (0, 53.5)),
)


def colour_by(mesh: trimesh.Trimesh, colour) -> trimesh.Trimesh:
    """`mesh` with sRGB vertex colours: one for all, or a function of the vertices."""
    values = colour(mesh.vertices) if callable(colour) else np.broadcast_to(colour, (len(mesh.vertices), 3))
    rgba = np.column_stack([np.clip(values, 0, 1), np.ones(len(mesh.vertices))])
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.round(255 * rgba).astype(np.uint8))
    return mesh


def mix(low, high, share):
    """Linear blend of two colours."""
    share = np.clip(share, 0, 1)[..., None]
    return np.asarray(low) * (1 - share) + np.asarray(high) * share


def turned(profile, colour, steps: int = 60) -> trimesh.Trimesh:
    """A surface of revolution about y through (radius, height) in millimetres, rounded by a spline."""
    points = np.asarray(profile, dtype=float) / 1000
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    fine = PchipInterpolator(along, points)(np.linspace(0, along[-1], steps))
    fine[:, 0] = np.maximum(fine[:, 0], 0)
    mesh = trimesh.creation.revolve(fine, sections=SECTIONS)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    return colour_by(mesh, colour)


def tube(points, radius: float, colour, sides: int = 8) -> trimesh.Trimesh:
    """A thin tube that narrows to half along a polyline, with parallel cross-sections."""
    points = np.asarray(points, dtype=float)
    ring = 2 * np.pi * np.arange(sides) / sides
    tangents = np.gradient(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    side = np.cross(tangents, [0.3, 0.1, 0.95])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangents, side)
    radii = radius * np.linspace(1, 0.5, len(points))
    vertices = points[:, None] + radii[:, None, None] * (
        np.cos(ring)[None, :, None] * side[:, None] + np.sin(ring)[None, :, None] * other[:, None]
    )
    faces = []
    for i in range(len(points) - 1):
        for j in range(sides):
            a, b = i * sides + j, i * sides + (j + 1) % sides
            faces += [[a, b, a + sides], [b, b + sides, a + sides]]
    return colour_by(trimesh.Trimesh(vertices.reshape(-1, 3), faces, process=False), colour)


def wood(size: int, rng: np.random.Generator) -> Image.Image:
    """Boards of wood, grain along the picture's height, four boards across; repeats without a seam."""
    y, x = np.mgrid[:size, :size] / size
    board = np.floor(x * 4).astype(int)
    shift = rng.uniform(0, 1, 4)[board]
    tint = rng.uniform(-0.07, 0.07, 4)[board]
    wave = sum(
        rng.uniform(0.4, 1) / k * np.sin(2 * np.pi * (k * y + shift * 7 + rng.uniform())) for k in (1, 2, 3)
    )
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * (22 * x + 0.35 * wave + 3 * shift))
    # Noise that is long along the boards and fine across them.
    along, across = np.fft.fftfreq(size)[:, None] * size / 5, np.fft.fftfreq(size)[None, :] * size / 110
    streak = np.fft.ifft2(np.fft.fft2(rng.normal(size=(size, size))) * np.exp(-(along**2) - across**2)).real
    streak /= streak.std()
    share = 0.35 * grain + 0.09 * streak + tint + 0.32
    rgb = mix((0.36, 0.21, 0.12), (0.68, 0.47, 0.29), share)
    gap = np.minimum((x * 4) % 1, 1 - (x * 4) % 1) < 0.012
    rgb[gap] *= 0.35
    return Image.fromarray(np.round(255 * np.clip(rgb, 0, 1)).astype(np.uint8))


def gingham(size: int) -> Image.Image:
    """One repeat of a red and white gingham weave."""
    stripe = (np.arange(size) // (size // 2)) % 2
    share = (stripe[:, None] + stripe[None, :]) / 2
    thread = 0.03 * (np.add.outer(np.arange(size), np.arange(size)) % 4 < 2)
    rgb = mix((0.95, 0.93, 0.88), (0.70, 0.11, 0.13), share) - thread[..., None]
    return Image.fromarray(np.round(255 * np.clip(rgb, 0, 1)).astype(np.uint8))


def slab(width: float, depth: float, thickness: float, image: Image.Image, repeat: float, quality: int):
    """A box with its top at y = 0; the picture repeats every `repeat` metres, on all sides."""
    mesh = trimesh.creation.box(extents=[width, thickness, depth])
    mesh.apply_translation([0, -thickness / 2, 0])
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    axis = np.abs(mesh.face_normals).argmax(axis=1).repeat(3)
    first = np.where(axis == 0, corners[:, 1], corners[:, 0])
    second = np.where(axis == 2, corners[:, 1], corners[:, 2])
    uv = np.column_stack([first, -second]) / repeat
    packed = io.BytesIO()
    image.save(packed, "JPEG", quality=quality)
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.open(packed), metallicFactor=0.0, roughnessFactor=0.6
    )
    faces = np.arange(len(corners)).reshape(-1, 3)
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return trimesh.Trimesh(corners, faces, visual=visual, process=False)


def apple() -> trimesh.Trimesh:
    """An apple of 7.6 cm with dimples at both ends and a stem."""
    angle = np.linspace(1e-3, np.pi - 1e-3, 49)
    radius = 0.038 * np.sin(angle) * (1 + 0.10 * np.cos(angle))
    height = 0.036 - 0.036 * np.cos(angle)
    height += 0.009 * np.exp(-((angle / 0.35) ** 2)) - 0.015 * np.exp(-(((np.pi - angle) / 0.40) ** 2))
    body = trimesh.creation.revolve(np.column_stack([radius, height - height.min()]), sections=SECTIONS)
    body.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))

    def skin(v):
        around = np.arctan2(v[:, 2], v[:, 0])
        blush = 0.55 + 0.35 * np.sin(around + 0.6) + 0.10 * np.sin(9 * around) * (v[:, 1] / 0.08)
        return mix((0.78, 0.68, 0.20), (0.70, 0.07, 0.07), blush)

    colour_by(body, skin)
    stem = tube([[0, 0.056, 0], [0.001, 0.068, 0.001], [0.004, 0.080, 0.002]], 0.0018, (0.30, 0.20, 0.10))
    return trimesh.util.concatenate([body, stem])


def books() -> trimesh.Trimesh:
    """Three books on a pile, each a cover around lighter pages."""
    parts, floor = [], 0.0
    rows = [
        (0.215, 0.150, 0.030, (0.10, 0.25, 0.34), 4),
        (0.195, 0.140, 0.024, (0.60, 0.20, 0.14), -9),
        (0.170, 0.120, 0.036, (0.80, 0.66, 0.32), 13),
    ]
    for width, depth, thick, cover, degrees in rows:
        board = 0.0022
        pages = trimesh.creation.box(extents=[width - 0.008, thick - 2 * board, depth - 0.008])
        pages.apply_translation([0, thick / 2, -0.002])
        pieces = [colour_by(pages, (0.88, 0.84, 0.74))]
        for y in (board / 2, thick - board / 2):
            lid = trimesh.creation.box(extents=[width, board, depth])
            lid.apply_translation([0, y, 0])
            pieces.append(colour_by(lid, cover))
        spine = trimesh.creation.box(extents=[width, thick, board])
        spine.apply_translation([0, thick / 2, depth / 2])
        pieces.append(colour_by(spine, cover))
        book = trimesh.util.concatenate(pieces)
        book.apply_transform(trimesh.transformations.rotation_matrix(np.deg2rad(degrees), [0, 1, 0]))
        book.apply_translation([0, floor, 0])
        floor += thick
        parts.append(book)
    return trimesh.util.concatenate(parts)


def leaf(base, direction, up, length: float, colour) -> trimesh.Trimesh:
    """A leaf folded a little along its middle: eight triangles."""
    direction = np.asarray(direction) / np.linalg.norm(direction)
    side = np.cross(direction, up)
    side /= np.linalg.norm(side)
    lift = np.cross(side, direction)
    stations = np.array([0, 0.3, 0.65, 1.0])
    width = np.array([0, 0.22, 0.18, 0]) * length
    bend = -0.25 * stations**2 * length
    middle = np.asarray(base) + np.outer(stations * length, direction) + np.outer(bend, lift)
    rows = [middle[0]]
    for i in (1, 2):
        raised = 0.25 * width[i] * lift
        rows += [middle[i] - width[i] * side + raised, middle[i], middle[i] + width[i] * side + raised]
    rows.append(middle[3])
    faces = [
        [0, 2, 1], [0, 3, 2], [1, 2, 4], [2, 5, 4], [2, 3, 5], [3, 6, 5], [4, 5, 7], [5, 6, 7],
    ]  # fmt: skip
    return colour_by(trimesh.Trimesh(rows, faces, process=False), colour)


def twigs(rng: np.random.Generator) -> trimesh.Trimesh:
    """Seven leafy twigs that spread from the mouth of a vase at y = 0."""
    parts = []
    for i in range(7):
        around = 2 * np.pi * i / 7 + rng.uniform(-0.3, 0.3)
        lean, length = rng.uniform(0.15, 0.75), rng.uniform(0.20, 0.34)
        share = np.linspace(0, 1, 14)
        out = lean * length * share**1.4
        points = np.column_stack(
            [out * np.cos(around), length * share * (1 - 0.18 * lean * share) - 0.05, out * np.sin(around)]
        )
        parts.append(tube(points, 0.0022, (0.33, 0.24, 0.15), sides=6))
        for j in range(3, 14):
            way = around + (1.35 if j % 2 else -1.35) + rng.uniform(-0.4, 0.4)
            direction = [np.cos(way), rng.uniform(0.2, 0.8), np.sin(way)]
            green = mix((0.16, 0.30, 0.12), (0.48, 0.58, 0.22), np.array(rng.uniform()))
            parts.append(leaf(points[j], direction, [0, 1, 0], rng.uniform(0.030, 0.048), green))
    return trimesh.util.concatenate(parts)


def bulbs(rng: np.random.Generator, count: int, width: float, sag: float) -> trimesh.Trimesh:
    """Small bulbs on a hanging string of `width` metres; its ends are at y = 0."""
    parts = []
    for x in np.linspace(-1, 1, count):
        ball = trimesh.creation.icosphere(subdivisions=1, radius=0.010)
        place = [width / 2 * x, -sag * (1 - x * x) + rng.uniform(-0.02, 0.02), rng.uniform(-0.15, 0.15)]
        ball.apply_translation(place)
        parts.append(ball)
    return colour_by(trimesh.util.concatenate(parts), (1, 1, 1))


def main() -> None:
    home = Path(__file__).resolve().parent.parent / "configs" / "meshes" / "still_life"
    parser = argparse.ArgumentParser(description="write the meshes of the still life")
    parser.add_argument("folder", nargs="?", type=Path, default=home)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)

    def glaze(v):
        return mix(
            (0.10, 0.32, 0.38), (0.78, 0.82, 0.74), (v[:, 1] / 0.22) ** 2 + 0.04 * np.sin(300 * v[:, 1])
        )

    def clay(v):
        return mix((0.72, 0.42, 0.25), (0.86, 0.75, 0.58), 0.5 + 0.5 * np.sin(90 * v[:, 1]))

    def wax_on_brass(v):
        return np.where(v[:, 1:2] < 0.019, (0.62, 0.48, 0.22), (0.93, 0.90, 0.82))

    def plaster(v):
        return mix((0.42, 0.34, 0.33), (0.16, 0.20, 0.34), 0.5 + v[:, 1] / 3.6)

    backdrop = trimesh.creation.box(extents=[6.0, 3.6, 0.05]).subdivide().subdivide().subdivide()
    meshes = {
        "table.glb": slab(1.9, 1.5, 0.035, wood(512, rng), 0.5, quality=85),
        "cloth.glb": slab(0.44, 0.62, 0.0015, gingham(64), 0.04, quality=95),
        "wall.ply": colour_by(backdrop, plaster),
        "vase.ply": turned(VASE, glaze, steps=84),
        "jug.ply": turned(JUG, clay, steps=72),
        "twigs.ply": twigs(rng),
        "apple.ply": apple(),
        "books.ply": books(),
        "candle.ply": turned(CANDLE, wax_on_brass),
        "flame.ply": turned(FLAME, (1, 1, 1), steps=16),
        "lamp_foot.ply": turned(LAMP_FOOT, (0.45, 0.36, 0.25), steps=40),
        "lamp_globe.ply": colour_by(trimesh.creation.icosphere(subdivisions=3, radius=0.075), (1, 1, 1)),
        "bulbs.ply": bulbs(rng, 21, 2.6, 0.28),
        "pawn.ply": turned(PAWN, (0.20, 0.12, 0.07), steps=80),
    }
    for name, mesh in meshes.items():
        mesh.export(folder / name)
        size = (folder / name).stat().st_size
        print(f"{name:16s} {len(mesh.faces):6d} triangles {size / 1024:8.1f} KiB")


if __name__ == "__main__":
    main()
