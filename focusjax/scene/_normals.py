"""Shading normals of meshes that have none: smooth across shallow edges, split at sharp ones."""

import numpy as np
from jaxtyping import Bool, Float, Int

_PAIRS_AT_ONCE = 2_000_000


def face_normals(corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3"]:
    """Unit normals, counter-clockwise seen from outside; zero for triangles without area."""
    edges = corners - corners[:, :1]
    # Scaling first keeps the products of tiny triangles from underflowing.
    longest = np.abs(edges).max(axis=(1, 2))
    edges = edges / np.where(longest == 0.0, 1.0, longest)[:, None, None]
    return unit_rows(np.cross(edges[:, 1], edges[:, 2]))


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
    corners = vertices[faces]
    normals = face_normals(corners)
    place = _places(vertices)[faces].ravel()
    weighted = (_corner_angles(corners)[..., None] * normals[:, None, :]).reshape(-1, 3)
    sums = np.stack([np.bincount(place, weighted[:, axis]) for axis in range(3)], axis=1)
    mean = unit_rows(sums)
    owner = np.repeat(np.arange(len(faces)), 3)
    own = normals[owner]
    result = mean[place]

    # Where all faces lie within half the angle of the mean, each pair is within the whole angle,
    # and the mean is the answer. Only the other places need a look at pairs of faces.
    limit = np.cos(np.deg2rad(smooth_angle))
    real = directed(normals)[owner]
    closeness = np.where(real, np.einsum("ij,ij->i", own, result), 1.0)
    least = np.ones(len(sums))
    np.minimum.at(least, place, closeness)
    creased = np.flatnonzero((least < np.cos(np.deg2rad(smooth_angle / 2)))[place] & real)
    result[creased] = _creased(place, weighted, own, creased, limit)

    missing = np.flatnonzero(~directed(result))
    result[missing] = own[missing]
    # A triangle without area has no direction at all; up is as good as any and finite.
    result[missing[~directed(own[missing])]] = (0.0, 1.0, 0.0)
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
    rows = np.ascontiguousarray(vertices + 0.0).view(np.dtype((np.void, 24))).ravel()
    return np.unique(rows, return_inverse=True)[1].ravel()


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
    result = np.zeros((len(wanted), 3))
    partners = count[place[wanted]]
    ends = np.cumsum(partners)
    start = 0
    while start < len(wanted):
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _PAIRS_AT_ONCE)))
        number = partners[start:stop]
        row = np.repeat(np.arange(stop - start), number)
        within = np.arange(len(row)) - np.repeat(np.cumsum(number) - number, number)
        other = order[first[place[wanted[start:stop]]][row] + within]
        # The rounding allowance keeps coplanar neighbours together at an angle of zero.
        alike = np.einsum("ij,ij->i", own[wanted[start:stop]][row], own[other]) >= limit - 1e-6
        kept = weighted[other] * alike[:, None]
        for axis in range(3):
            result[start:stop, axis] = np.bincount(row, kept[:, axis], minlength=stop - start)
        start = stop
    return unit_rows(result)
