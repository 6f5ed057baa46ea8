"""From a photograph and its depth to a scene of unlit triangles in front of the camera that took it.

Four objects: `photograph`, what is seen and opaque; `holes`, the same where the depth was not measured;
`edges`, the foreground in pixels that hold a mixture at silhouettes; `guess`, what nobody photographed:
behind foregrounds, and beyond the frame, where the photograph goes on as its mirror image. See `_tears`,
`_hidden`, `_beyond`, `_mattes` and `_mesh`.
"""

import dataclasses

import numpy as np
import scipy
from jaxtyping import Bool, Float

from focusjax.geometry import Camera
from focusjax.photo._align import nearest_known
from focusjax.photo._beyond import extended
from focusjax.photo._hidden import LAMP, MIXED, MIXED_EXACT, carried_behind, membrane, without_lamps
from focusjax.photo._mattes import Mattes, mattes
from focusjax.photo._mesh import Squares, squares, triangles
from focusjax.photo._tears import GAP, links, torn_sides, without_slivers
from focusjax.scene import Material, Scene, SceneObject, constant_background, make_scene

SEEN, HOLES, EDGES, GUESS = "photograph", "holes", "edges", "guess"
_BORDER = 4
"""Pixels beyond the frame that are there however small the blur."""
_FARTHEST = 0.02
"""Blur in pixels by which what is infinitely far may be off: triangles have to be somewhere."""
_APART = 1.5
"""Of the gap that makes a tear, how far apart what is behind has to be from what is before it."""
_NEAR_SIDE = 4
"""Pixels around a tear within which a foreground's colour is looked for."""


@dataclasses.dataclass(frozen=True)
class Sheets:
    """Two surfaces of a photograph on one grid, with a border.

    Attributes:
        border: pixels around the frame.
        near: disparity [h, w] of what is seen, foregrounds with all pixels that hold some of them.
        far: disparity [h, w] of what is behind and, where nothing is, of what is seen.
        behind: where [h, w] there is a surface behind another.
        seen_behind: where that surface shows, too: the far half of a mixture.
        band: pixels [h, w] at silhouettes.
        matte: their shares and colours, and those of all others.
    """

    border: int
    near: Float[np.ndarray, "h w"]
    far: Float[np.ndarray, "h w"]
    behind: Bool[np.ndarray, "h w"]
    seen_behind: Bool[np.ndarray, "h w"]
    band: Bool[np.ndarray, "h w"]
    matte: Mattes


def sheets(
    light: Float[np.ndarray, "h w 3"], disparity: Float[np.ndarray, "h w"], parallax: float, edge_px: int
) -> Sheets:
    """What is seen and what is guessed behind it.

    Args:
        light: the photograph, linear.
        disparity: 1/m of every pixel, at least 0.
        parallax: pixels per dioptre at the rim of the widest lens.
        edge_px: pixels on either side of a tear that may hold a mixture.
    """
    least = _FARTHEST / max(parallax, 1e-12)
    disparity = np.maximum(disparity, least).astype(np.float32)
    if edge_px > 1:
        disparity = without_slivers(disparity, parallax)
    border = min(int(np.ceil(parallax * (disparity.max() - disparity.min()))) + _BORDER, *disparity.shape)
    depth = np.pad(disparity, border, mode="symmetric")
    picture = extended(light, border)
    near_sides, far_sides = torn_sides(depth, links(depth, parallax))
    near_band, far_band = _widened(depth, near_sides, far_sides, parallax, edge_px)
    band = near_band | far_band
    step = GAP / max(parallax, 1e-12)
    carried = carried_behind(depth, band, far_band, near_band, far_sides, parallax)
    behind = np.isfinite(carried)
    far_depth = np.where(behind, carried, depth)
    trusted = ~band
    only_hidden = np.where(far_band, np.nan, carried)
    start = far_depth[..., None]
    known = ((trusted | far_band) & np.isnan(only_hidden)).astype(np.float32)
    far = membrane(only_hidden, depth, known, start, start, step)[..., 0].astype(np.float32)
    near = np.where(far_band & behind, _near_depth(depth, near_band, edge_px), depth)
    # A membrane may swing before what hides it; layers take surfaces that are closer together for one.
    apart = _APART * step
    far = np.where(behind & ~far_band, np.minimum(far, near - apart), far)
    behind &= (near - far >= 0.999 * apart) & (far >= least)
    band, seen_behind = band & behind, far_band & behind
    near, far = np.where(behind, near, depth), np.where(behind, far, depth)
    surfaces = without_lamps(picture, int(LAMP * max(light.shape[:2])))
    # A first guess of colours behind: those of the nearest pixel that is trusted and hides nothing.
    nearest = nearest_known(surfaces, trusted & ~behind)
    weight = np.where(trusted, 1.0, MIXED_EXACT if edge_px == 1 else MIXED).astype(np.float32)
    back = membrane(np.where(behind, far, np.nan), depth, weight, surfaces, nearest, step)
    near_side = near_band | (
        scipy.ndimage.binary_dilation(near_band, iterations=_NEAR_SIDE) & _as_near(depth, near_band, step)
    )
    matte = mattes(picture, back.astype(np.float32), near_side, band, near_band)
    return Sheets(border, near, far, behind, seen_behind, band, matte)


def _widened(
    depth: np.ndarray, near: np.ndarray, far: np.ndarray, parallax: float, edge_px: int
) -> tuple[np.ndarray, np.ndarray]:
    """The sides of tears, `edge_px` wide each: a pixel belongs to the side that it is as far away as."""
    # What is on both sides, between two silhouettes, is a foreground: the lens sees past it.
    far = far & ~near
    step = GAP / max(parallax, 1e-12)
    for _ in range(edge_px - 1):
        cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=bool)
        high = scipy.ndimage.grey_dilation(np.where(near, depth, -1.0), footprint=cross)
        low = scipy.ndimage.grey_dilation(np.where(far, depth, -1.0), footprint=cross)
        free = ~near & ~far
        more_near = free & (high >= 0) & (np.abs(high - depth) <= step)
        more_far = free & (low >= 0) & (np.abs(low - depth) <= step) & ~more_near
        near, far = near | more_near, far | more_far
    return near, far


def _as_near(depth: np.ndarray, near_band: np.ndarray, step: float) -> np.ndarray:
    """Whether pixels are about as near as the nearest band around them."""
    around = scipy.ndimage.grey_dilation(np.where(near_band, depth, -1.0), size=2 * _NEAR_SIDE + 1)
    return np.abs(around - depth) <= 4 * step


def _near_depth(depth: np.ndarray, near_band: np.ndarray, edge_px: int) -> np.ndarray:
    """Disparity of the foreground beside each pixel of its far band."""
    around = scipy.ndimage.grey_dilation(np.where(near_band, depth, -1.0), size=2 * edge_px + 1)
    return np.where(around > depth, around, depth).astype(np.float32)


def photo_scene(
    light: Float[np.ndarray, "h w 3"],
    disparity: Float[np.ndarray, "h w"],
    measured: Bool[np.ndarray, "h w"],
    camera: Camera,
    pupil_radius: float,
    edge_px: int,
) -> Scene:
    """The scene of a photograph, for lenses with pupils of at most `pupil_radius` metres in its place."""
    parallax = float(camera.focal_px) * pupil_radius
    return scene_of(sheets(light, disparity, parallax, edge_px), measured, camera, parallax)


def scene_of(found: Sheets, measured: Bool[np.ndarray, "h w"], camera: Camera, parallax: float) -> Scene:
    """Objects of two sheets."""
    height, width = found.near.shape
    inside = np.zeros((height, width), dtype=bool)
    border = found.border
    inside[border : height - border, border : width - border] = True
    holes = np.pad(~measured, border)
    share = found.matte.share
    mixed = found.band & (share < 1.0)
    # Where the foreground takes a whole pixel, what is behind it is a guess like any other.
    shows_behind = found.seen_behind & (share < 1.0) & inside
    near_links, far_links = links(found.near, parallax), links(found.far, parallax)
    near_light, far_light = found.matte.near, found.matte.far

    def objects(
        name: str, parts: list[tuple[Squares, bool]], *, opacity: np.ndarray | None = None
    ) -> list[SceneObject]:
        some = [(each, far) for each, far in parts if len(each.row)]
        if not some:
            return []
        return [_object(name, some, (near_light, far_light), camera, border, opacity)]

    def near(there: np.ndarray) -> tuple[Squares, bool]:
        return squares(found.near, near_links, there, parallax), False

    def far(there: np.ndarray) -> tuple[Squares, bool]:
        return squares(found.far, far_links, there, parallax), True

    made = [
        *objects(SEEN, [near(~mixed & inside & ~holes), far(shows_behind)]),
        *objects(HOLES, [near(~mixed & inside & holes)]),
        *objects(EDGES, [near(mixed & (share > 0) & inside)], opacity=share),
        *objects(GUESS, [near(~mixed & ~inside), far(found.behind & ~shows_behind)]),
    ]
    return make_scene(made, unlit=True, background=constant_background(0.0))


def _object(
    name: str,
    parts: list[tuple[Squares, bool]],
    pictures: tuple[np.ndarray, np.ndarray],
    camera: Camera,
    border: int,
    opacity: np.ndarray | None,
) -> SceneObject:
    """Triangles with the near or the far picture on them."""
    height, width = pictures[0].shape[:2]
    middle = np.asarray(camera.principal_point, dtype=float) + border
    focal, pose = float(camera.focal_px), np.asarray(camera.world_from_camera, dtype=float)
    found: list[dict[str, np.ndarray]] = []
    offset = 0
    for some, is_far in parts:
        corners, faces = triangles(some, width, shared=opacity is None)
        x, y, w = corners.T
        ahead = np.stack([(x - middle[0]) / focal, -(y - middle[1]) / focal, -np.ones_like(x)], axis=1)
        share = np.ones(1) if opacity is None else opacity[some.row, some.column]
        found.append(
            {
                "vertices": (ahead / w[:, None]) @ pose[:3, :3].T + pose[:3, 3],
                "faces": faces + offset,
                "uv": np.stack([x / width, 1.0 - y / height], axis=1),
                "far": np.full(len(faces), is_far),
                "share": np.repeat(share, 4),
            }
        )
        offset += len(corners)
    arrays = {key: np.concatenate([each[key] for each in found]) for key in found[0]}
    count = len(arrays["vertices"])
    used = [picture for picture in (0, 1) if (arrays["far"] == picture).any()]
    return SceneObject(
        name=name,
        vertices=arrays["vertices"],
        faces=arrays["faces"].astype(np.int32),
        normals=np.broadcast_to(np.array([0, 0, 1], dtype=np.float32), (count, 3)),
        uv=arrays["uv"],
        colours=np.broadcast_to(np.float32(1), (count, 3)),
        face_material=(
            arrays["far"].astype(np.int32) if len(used) > 1 else np.zeros(len(arrays["far"]), np.int32)
        ),
        materials=tuple(
            Material(np.ones(3), np.zeros(3), np.zeros(3), texture=place, pixels=True)
            for place in range(len(used))
        ),
        textures=tuple(pictures[k] for k in used),
        vertex_opacity=None if opacity is None else arrays["share"],
    )
