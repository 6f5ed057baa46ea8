"""Random triangle soups: whatever the triangles, layers of every kind agree with an Embree ray cast."""

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from small_scenes import at_pixels, front_camera, wide_lens

from focusjax.baselines import RayCaster
from focusjax.layers import Layers, decompose, peel
from focusjax.scene import Scene, make_object, make_scene

CAMERA = front_camera()
# So small a parallax that the margin is the same whatever is drawn, and few programs are compiled.
LENS = wide_lens(CAMERA, pixels_per_dioptre=4.0)
MOST = 8
# A failure is shown as found: to look for a smaller one would take minutes of compiling.
_QUICK = (Phase.explicit, Phase.generate)
_UNFILTERED = (HealthCheck.filter_too_much,)

WAYS = {
    "umbra": lambda scene: peel(scene, CAMERA, LENS, supersampling=1, max_layers=MOST),
    "plain": lambda scene: peel(scene, CAMERA, LENS, supersampling=1, max_layers=MOST, umbra=False),
    "slabs": lambda scene: decompose(scene, CAMERA, LENS, supersampling=1, count=MOST),
}


def random_corners(seed: int) -> np.ndarray:
    """Triangles [t, 3, 3] of all sizes anywhere in the unit cube."""
    random = np.random.default_rng(seed)
    centre = random.uniform(size=(random.integers(1, MOST + 1), 1, 3))
    size = 10 ** random.uniform(-1.5, 0.5, size=centre.shape)
    return np.clip(centre + size * random.uniform(-1, 1, size=(len(centre), 3, 3)), 0, 1)


# Ordinary triangles, and the odd ones that hypothesis finds: flat, edge-on, coincident.
corners = st.one_of(
    st.integers(0, 2**32 - 1).map(random_corners),
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(1, MOST), st.just(3), st.just(3)),
        elements=st.floats(0.0, 1.0, width=32, allow_subnormal=False),
    ),
)


def soup(unit: np.ndarray, glass: int = 0) -> tuple[Scene, np.ndarray]:
    """The scene, and the triangles' corners [t, 3, 2] in the picture, from points [t, 3, 3] of the unit cube.

    They reach somewhat beyond the frame, and from 0.2 to 1.2 per metre. The first few may be of `glass`.
    """
    xy = unit[..., :2] * [CAMERA.width + 12, CAMERA.height + 12] - 6.0
    points = at_pixels(xy.reshape(-1, 2), 0.2 + unit[..., 2].ravel(), CAMERA).reshape(-1, 3, 3)
    objects = []
    for name, part, opacity in (("glass", points[:glass], 0.4), ("solid", points[glass:], 1.0)):
        # An object that is nothing but lines and points is refused.
        if len(part):
            assume(has_area(part))
            corners = part.reshape(-1, 3)
            faces = np.arange(len(corners)).reshape(-1, 3)
            colours = np.linspace(0.1, 0.9, corners.size).reshape(-1, 3)
            objects.append(make_object(name, corners, faces, vertex_colours=colours, opacity=opacity))
    return make_scene(objects, unlit=True), xy


def has_area(triangles: np.ndarray) -> bool:
    """Whether any of `triangles` [t, 3, 3] is clearly more than a line or a point."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    doubled = np.linalg.norm(np.cross(first, second), axis=1)
    longest = np.maximum((first**2).sum(axis=1), (second**2).sum(axis=1))
    return bool((doubled > 1e-9 * longest).any())


def distance_to_edges(xy: np.ndarray, places: np.ndarray) -> np.ndarray:
    """From each of `places` [n, 2] to the nearest side of any triangle [t, 3, 2]."""
    start, side = xy[:, :, None], (np.roll(xy, -1, axis=1) - xy)[:, :, None]
    along = ((places - start) * side).sum(axis=-1) / np.maximum((side**2).sum(axis=-1), 1e-12)
    away = places - start - np.clip(along, 0.0, 1.0)[..., None] * side
    return np.sqrt((away**2).sum(axis=-1)).min(axis=(0, 1))


def surfaces_along(scene: Scene, xy: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Disparities [k, n] of all surfaces seen at `places` from the lens centre, nearest first, then 0.

    Embree may meet one a second time, right behind the first, where it is seen edge-on, and meets those that
    have no area in the picture anywhere: they are left out.
    """
    first, second = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    if not (area > 1e-9).any():
        return np.zeros((2, len(places)))
    caster = RayCaster(scene.vertices, scene.faces[area > 1e-9])
    directions = at_pixels(places, np.ones(len(places)), CAMERA)
    depth, found = np.zeros(len(places)), []
    for _ in range(len(scene.faces) + 1):
        hits = caster.first_hits(directions * depth[:, None], directions)
        depth = depth + hits.distance
        found.append(1.0 / depth)
        depth = np.where(np.isfinite(depth), depth * (1 + 1e-4), 1e9)
    return np.stack(found)


def at_pixel_centres(layers: Layers) -> np.ndarray:
    """Disparities [l, pixels] of what the centres of the frame's samples show; 0 for fringe samples."""
    margin = layers.grid.margin
    disparity = np.where(np.asarray(layers.triangle) >= 0, np.asarray(layers.disparity), 0.0)
    return disparity[:, margin:-margin, margin:-margin].reshape(layers.count, -1)


@pytest.mark.parametrize("way", WAYS)
@given(unit=corners, glass=st.sampled_from([0, 0, 1, MOST]))
@settings(max_examples=24, deadline=None, derandomize=True, phases=_QUICK, suppress_health_check=_UNFILTERED)
def test_layers_of_soups_agree_with_a_ray_cast(way: str, unit: np.ndarray, glass: int):
    scene, xy = soup(unit, glass)
    layers = WAYS[way](scene)
    for name in ("disparity", "radiance", "background"):
        assert np.isfinite(getattr(layers, name)).all(), name
    ours = at_pixel_centres(layers)
    assert not ((ours[1:] > 0) & (ours[1:] >= ours[:-1])).any()

    y, x = np.mgrid[: CAMERA.height, : CAMERA.width] + 0.5
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    theirs = surfaces_along(scene, xy, places)
    step = np.diff(theirs, axis=0)
    # Not where a side passes through the centre, or two surfaces do so at one depth: either answer is right.
    crossing = ((theirs[:-1] > 0) & (np.abs(step) < 1e-3 * theirs[:-1])).any(axis=0)
    clear = (distance_to_edges(xy, places) > 0.01) & ~crossing
    ours, theirs = ours[:, clear], theirs[:, clear]
    same = np.abs(ours[:, None] - theirs) <= 1e-4 * theirs
    # Each layer's surface is one of those there are, and the first is the first.
    assert (same & (theirs > 0)).any(axis=1)[ours > 0].all()
    assert same[0, 0].all()
    if way == "plain":
        count = min(len(ours), len(theirs))
        assert (np.abs(ours[:count] - theirs[:count]) <= 1e-4 * theirs[:count]).all()
        assert not theirs[count:].any() or not layers.complete


@pytest.mark.parametrize("way", WAYS)
@given(unit=corners)
@settings(max_examples=8, deadline=None, derandomize=True, phases=_QUICK, suppress_health_check=_UNFILTERED)
def test_what_is_there_twice_is_held_once(way: str, unit: np.ndarray):
    once, twice = (WAYS[way](soup(triangles)[0]) for triangles in (unit, np.concatenate([unit, unit])))
    for name in ("disparity", "cells"):
        np.testing.assert_array_equal(getattr(twice, name), getattr(once, name))
