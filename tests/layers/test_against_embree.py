"""Layers against an Embree ray cast, layer by layer, and what the peel left out against visibility."""

from functools import cache

import numpy as np
import pytest
from reference_scenes import load_reference
from scipy import ndimage

from focusjax.baselines import RayCaster
from focusjax.layers import Layers, disparity_map, peel

SETTINGS = [("cow_bars", "dof_strong_foreground"), ("town_tree", "dof_focus_tree")]


@cache
def peeled(name: str, view: str) -> tuple[Layers, RayCaster, float]:
    """Layers, the same triangles for Embree, and f E in samples per dioptre."""
    reference = load_reference(name)
    scene, lens = reference.scene, reference.lenses[view]
    layers = peel(scene, reference.camera, lens, supersampling=1)
    return layers, RayCaster(scene.vertices, scene.faces), float(lens.parallax(reference.camera))


def at_centres(layers: Layers) -> np.ndarray:
    """Disparity [l, h, w] of what the samples' centres show; 0 also for fringe samples."""
    disparity = np.asarray(layers.disparity, dtype=np.float64)
    return np.where(np.asarray(layers.triangle) >= 0, disparity, 0.0)


def view_rays(layers: Layers, offset: tuple[float, float] = (0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """The lens centre [3] and directions [h * w, 3], a metre deep, through the layers' samples."""
    grid, camera = layers.grid, layers.camera
    x, y = np.meshgrid(np.arange(grid.columns) + 0.5 + offset[0], np.arange(grid.rows) + 0.5 + offset[1])
    xy = (np.stack([x, y], axis=-1).reshape(-1, 2) - grid.margin) / grid.supersampling
    right, down = ((xy - np.asarray(camera.principal_point)) / float(camera.focal_px)).T
    pose = np.asarray(camera.world_from_camera)
    return pose[:3, 3], np.stack([right, -down, -np.ones_like(right)], axis=1) @ pose[:3, :3].T


def hidden_below(disparity: np.ndarray, parallax: float, layer: int) -> np.ndarray:
    """Disparity [h, w] below which the layer at `disparity` hides what is behind it; the peel's own rule.

    `parallax` is f E in samples per dioptre. Where the surface continues from sample to sample up to r
    away, it hides what lies r / (f E) below its nearest point there; beyond the second layer only the
    nearest neighbours are asked.
    """

    def largest(a: np.ndarray, radius: int) -> np.ndarray:
        return ndimage.maximum_filter(a, 2 * radius + 1, mode="constant", cval=0.0)

    def least(a: np.ndarray, radius: int) -> np.ndarray:
        return ndimage.minimum_filter(a, 2 * radius + 1, mode="constant", cval=0.0)

    step = 1.0 / parallax
    cut = np.minimum(disparity * (1 - 1e-5), disparity - 0.5 * step)
    continued = ((least(disparity, 1) > 0) & (largest(disparity, 1) - least(disparity, 1) <= step)).astype(
        float
    )
    levels = int(parallax * disparity.max()).bit_length() + 1 if layer < 2 else 1
    for level in range(levels):
        radius = 2**level
        solid = least(continued, radius - 1) > 0
        cut = np.where(solid, np.minimum(cut, largest(disparity, radius) - radius * step), cut)
    return cut


def next_surface(
    layers: Layers, caster: RayCaster, beyond: np.ndarray, offset: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Disparity [h, w] of the first surface below `beyond` [h, w]; 0 where there is none."""
    eye, directions = view_rays(layers, offset)
    limit = beyond.reshape(-1)
    start = np.where(limit > 0, 1.0 / np.where(limit > 0, limit, 1.0), 0.0)
    hits = caster.first_hits(eye + directions * start[:, None], directions)
    found = (hits.triangle >= 0) & (limit > 0)
    depth = np.where(found, start + hits.distance, np.inf)
    return (1.0 / depth).reshape(beyond.shape)


def in_frame(layers: Layers) -> np.ndarray:
    """The samples [h, w] inside the picture; in the margin, what no ray reaches is not kept."""
    grid = layers.grid
    mask = np.zeros((grid.rows, grid.columns), dtype=bool)
    mask[grid.margin : grid.rows - grid.margin, grid.margin : grid.columns - grid.margin] = True
    return mask


def agree(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Where depths are within 1e-4 relative, or both are missing."""
    return np.abs(ours - theirs) <= 1e-4 * np.maximum(ours, theirs)


@pytest.mark.parametrize(("name", "view"), SETTINGS)
def test_every_layer_is_the_next_surface(name: str, view: str) -> None:
    layers, caster, parallax = peeled(name, view)
    disparity = at_centres(layers)
    near = 0.1 * float(layers.camera.focal_length)
    beyond = np.full(disparity.shape[1:], 1.0 / near)
    for number, ours in enumerate(disparity):
        theirs = next_surface(layers, caster, beyond)
        right = agree(ours, theirs) | ~in_frame(layers)
        # Observed: none differs in any layer of cow_bars, 2 of 49152 in the first of town_tree.
        surfaces = int((np.maximum(ours, theirs) > 0)[in_frame(layers)].sum())
        assert (~right).sum() <= max(2.0, 0.001 * surfaces), f"layer {number}"
        # What is left lies at triangle edges: a hundredth of a sample aside, the rays agree.
        at_edge = right
        if not right.all():
            for aside in ((0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)):
                shifted = next_surface(layers, caster, beyond, aside)
                at_edge = at_edge | (np.abs(ours - shifted) <= 1e-3 * np.maximum(ours, shifted))
        assert at_edge.all(), f"layer {number}"
        beyond = np.where(ours > 0, hidden_below(ours, parallax, number), 0.0)


@pytest.mark.parametrize(("name", "view"), SETTINGS)
def test_surfaces_left_out_cannot_be_seen(name: str, view: str) -> None:
    """Every surface behind the first, in or out of the layers; those left out are invisible from the lens."""
    layers, caster, parallax = peeled(name, view)
    camera, disparity = layers.camera, at_centres(layers)
    eye, directions = view_rays(layers)
    chosen = np.random.default_rng(0).permutation(np.flatnonzero(in_frame(layers)))[:4000]
    directions, kept = directions[chosen], disparity.reshape(layers.count, -1)[:, chosen]
    pupil = _disk(48) * parallax / float(camera.focal_px)
    lens_points = eye + pupil @ np.asarray(camera.world_from_camera)[:3, :2].T
    depth = np.full(len(chosen), 0.1 * float(camera.focal_length))
    seen = left_out = 0
    for _ in range(6):
        hits = caster.first_hits(eye + directions * depth[:, None], directions)
        depth = np.where(hits.triangle >= 0, depth + hits.distance, np.inf)
        missing = np.isfinite(depth) & ~agree(kept, 1.0 / depth).any(axis=0)
        points = eye + directions[missing] * depth[missing, None]
        left_out += len(points)
        visible = np.zeros(len(points))
        for origin in lens_points:
            blocked = caster.first_hits(np.broadcast_to(origin, points.shape), points - origin).distance
            visible += blocked > 1 - 1e-4
        seen += int((visible > 0).sum())
        depth = np.where(np.isfinite(depth), depth * (1 + 2e-5), 1e9)
    # Observed: 8 of 2969 and 19 of 9437. They lie close behind a silhouette that passes within half a sample
    # of them; the sample in front then stands for both.
    assert left_out > 2000
    assert seen <= 0.004 * left_out


def _disk(count: int) -> np.ndarray:
    """Points [count, 2] spread over the unit disk, the last ones on its rim."""
    index = np.arange(count)
    radius, angle = np.sqrt((index + 1) / count), 2.399963 * index
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("name", ["cow_bars", "town_tree"])
def test_disparity_map_is_the_first_surface(name: str) -> None:
    reference = load_reference(name)
    ours = disparity_map(reference.scene, reference.camera)
    camera = reference.camera
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    pose = np.asarray(camera.world_from_camera)
    centre, focal = np.asarray(camera.principal_point), float(camera.focal_px)
    local = np.stack([(x - centre[0]) / focal, -(y - centre[1]) / focal, -np.ones_like(x)], axis=-1)
    directions = local.reshape(-1, 3) @ pose[:3, :3].T
    hits = RayCaster(reference.scene.vertices, reference.scene.faces).first_hits(
        np.broadcast_to(pose[:3, 3], directions.shape), directions
    )
    # Observed: 0 and 2 of 49152 pixels differ.
    right = agree(ours, (1.0 / hits.distance).reshape(ours.shape))
    assert right.mean() >= 0.999
