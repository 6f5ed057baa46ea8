"""Shading normals of meshes that have none: smooth across shallow edges, split at sharp ones."""

import functools

import numpy as np
from jaxtyping import Bool, Float, Int

from focusjax._parallel import in_parallel, parts

_PAIRS_AT_ONCE = 1 << 17
_FACES_AT_ONCE = 1 << 14
_ODD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


def face_normals(corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3"]:
    """Unit normals, counter-clockwise seen from outside; zero for triangles without area."""
    edges = corners[:, 1:] - corners[:, :1]
    # Scaling first keeps the products of tiny triangles from underflowing.
    longest = functools.reduce(np.maximum, np.abs(edges).reshape(-1, 6).T)
    edges /= np.where(longest == 0.0, 1.0, longest)[:, None, None]
    return unit_rows(np.cross(edges[:, 0], edges[:, 1]))


def smooth_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"], smooth_angle: float
) -> Float[np.ndarray, "t 3 3"]:
    """Unit normals of each face's three corners.

    A corner averages the normals, weighted by the angle there (Thuermer and Wuethrich 1998), of
    all faces that share its position and lie within `smooth_angle` of its own face. Positions
    count, not vertex numbers: seams of a texture do not show.

    Args:
        vertices: metres.
        faces: vertex numbers.
        smooth_angle: degrees; 0 gives flat facets, 180 a wholly smooth surface.
    """
    chunks = parts(len(faces), _FACES_AT_ONCE) or [slice(0, 0)]

    def weigh(chunk: slice) -> tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, "c 3"]]:
        corners = vertices[faces[chunk]]
        normals = face_normals(corners)
        return normals, (_corner_angles(corners)[..., None] * normals[:, None, :]).reshape(-1, 3)

    normals, weighted = (np.concatenate(a) for a in zip(*in_parallel(weigh, chunks), strict=True))
    place = _places(vertices)[faces].ravel()
    # Threads take longer to start than a small mesh takes.
    every = map if len(chunks) == 1 else in_parallel
    sums = np.stack(list(every(lambda axis: np.bincount(place, weighted[:, axis]), range(3))), axis=1)
    mean = unit_rows(sums)

    # Where all faces lie within half the angle of the mean, each pair is within the whole angle,
    # and the mean is the answer. Only the other places need a look at pairs of faces.
    limit = np.cos(np.deg2rad(smooth_angle))
    result = np.empty((len(place), 3))
    least = np.ones(len(sums))
    real = directed(normals)

    def compare(corners: slice) -> Float[np.ndarray, " c"]:
        result[corners] = mean[place[corners]]
        face = np.arange(corners.start, corners.stop) // 3
        closeness = np.einsum("ij,ij->i", normals[face], result[corners])
        return np.where(real[face], closeness, 1.0)

    of_corners = [slice(3 * chunk.start, 3 * chunk.stop) for chunk in chunks]
    for corners, closeness in zip(of_corners, in_parallel(compare, of_corners), strict=True):
        np.minimum.at(least, place[corners], closeness)
    sharp = least < np.cos(np.deg2rad(smooth_angle / 2))
    # Those at one place with any that are looked at are among the candidates.
    candidates = np.flatnonzero(sharp[place])
    own = normals[candidates // 3]
    wanted = np.flatnonzero(real[candidates // 3])
    result[candidates[wanted]] = _creased(place[candidates], weighted[candidates], own, wanted, limit)

    missing = np.flatnonzero(~directed(result))
    own = normals[missing // 3]
    # A triangle without area has no direction at all; up is as good as any and finite.
    own[~directed(own)] = (0.0, 1.0, 0.0)
    result[missing] = own
    return result.reshape(-1, 3, 3)


def directed(rows: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, "*n"]:
    """Whether rows are not all zeros: column by column, which is ten times as quick as row by row."""
    return (rows[..., 0] != 0) | (rows[..., 1] != 0) | (rows[..., 2] != 0)


def unit_rows(rows: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Rows scaled to length 1; rows of zeros or of values that are not finite become zero."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    usual = np.isfinite(length) & (length > 0.0)
    if not usual.all():
        rows = np.where(usual[:, None], rows, 0.0)
    return rows / np.where(usual, length, 1.0)[:, None]


def _places(vertices: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, "v"]:
    """A number for each vertex, the same for vertices at the same position."""
    # Adding zero turns -0.0 into 0.0, which are equal but have different bytes.
    rows = np.ascontiguousarray(vertices + 0.0)
    # By a hash first, as whole numbers sort more quickly than rows; two may have the same by chance.
    bits = rows.view(np.uint64)
    # Simple numbers have zeros in their low bits, which a product would keep.
    mixed = (bits ^ (bits >> np.uint64(29))) * _ODD
    hashed = mixed[:, 0] + mixed[:, 1] + mixed[:, 2]
    _, first, number = np.unique(hashed, return_index=True, return_inverse=True)
    number = number.ravel()
    if (rows == rows[first[number]]).all():
        return number
    return np.unique(rows.view(np.dtype((np.void, 24))).ravel(), return_inverse=True)[1].ravel()


def _corner_angles(corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3"]:
    """The angles in radians at the corners; zero where an edge has no length."""
    ahead = np.stack([unit_rows(corners[:, (i + 1) % 3] - corners[:, i]) for i in range(3)], axis=1)
    behind = -np.roll(ahead, 1, axis=1)
    angles = np.arccos(np.clip(np.einsum("tij,tij->ti", ahead, behind), -1.0, 1.0))
    return np.where(directed(ahead) & directed(behind), angles, 0.0)


def _creased(
    place: Int[np.ndarray, "c"],
    weighted: Float[np.ndarray, "c 3"],
    own: Float[np.ndarray, "c 3"],
    wanted: Int[np.ndarray, "n"],
    limit: float,
) -> Float[np.ndarray, "n 3"]:
    """Normals of the corners `wanted`, each from the corners at its place that face its way."""
    order = np.argsort(place, kind="stable")
    count = np.bincount(place)
    first = np.cumsum(count) - count
    partners = count[place[wanted]]
    ends = np.cumsum(partners)

    def some(part: slice) -> Float[np.ndarray, "k 3"]:
        number = partners[part]
        row = np.repeat(np.arange(len(number)), number)
        within = np.arange(len(row)) - np.repeat(np.cumsum(number) - number, number)
        other = order[first[place[wanted[part]]][row] + within]
        # The rounding allowance keeps coplanar neighbours together at an angle of zero.
        alike = np.einsum("ij,ij->i", own[wanted[part]][row], own[other]) >= limit - 1e-6
        kept = weighted[other] * alike[:, None]
        sums = [np.bincount(row, kept[:, axis], minlength=len(number)) for axis in range(3)]
        return np.stack(sums, axis=1)

    chunks, start = [], 0
    while start < len(wanted):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _PAIRS_AT_ONCE)))
        chunks.append(slice(start, stop))
        start = stop
    return unit_rows(np.concatenate([np.zeros((0, 3)), *in_parallel(some, chunks)]))
