"""The scene of a photograph: sharp it is the photograph again, and behind the disk the wall goes on."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from depth_photos import FAR_M, NEAR_M, disk_scene
from scipy.ndimage import binary_dilation, shift

from focusjax.geometry import make_camera
from focusjax.layers import disparity_map, peel
from focusjax.lens import thin_lens
from focusjax.photo import GUESS, HOLES, SEEN, Photo
from focusjax.photo._beyond import extended
from focusjax.photo._hidden import without_lamps
from focusjax.photo._mattes import mattes
from focusjax.photo._scene import sheets
from focusjax.photo._tears import links, torn_sides, without_slivers
from focusjax.scene import constant_background
from focusjax.trace import render, render_pinhole

WIDTH, HEIGHT = 64, 48
CAMERA = make_camera(np.eye(4), width=WIDTH, height=HEIGHT, focal_length=0.035)


def photo(light=None, depth=None, measured=None):
    picture, usual = disk_scene(WIDTH, HEIGHT)
    light = (picture / 255.0).astype(np.float32) if light is None else light
    depth = usual if depth is None else depth
    measured = np.ones(depth.shape, bool) if measured is None else measured
    return Photo(light, (1 / depth).astype(np.float32), measured, CAMERA, 1, Path("photo.png"))


def lens_at(distance, f_number=0.5):
    return thin_lens(focus_distance=distance, focal_length=0.035, f_number=f_number)


@pytest.fixture(scope="module")
def disk():
    found = photo()
    scene = found.scene(f_number=0.5)
    return found, scene, peel(scene, CAMERA, lens_at(FAR_M))


def test_the_sharp_view_is_the_photograph(disk):
    found, scene, layers = disk
    # Each pixel its own square, with its own texel; observed 6e-8 with opaque edges.
    np.testing.assert_allclose(np.asarray(render_pinhole(layers)), found.light, atol=2e-3)
    seen = np.asarray(disparity_map(scene, CAMERA))
    assert (np.abs(seen - found.disparity) < 1e-4).mean() > 0.97


def test_in_focus_the_photograph_stays_and_blur_spreads_the_disk(disk):
    found, _, layers = disk
    on_disk = np.asarray(render(layers, lens_at(NEAR_M), rays=64))
    middle = np.s_[HEIGHT // 2 - 4 : HEIGHT // 2 + 4, WIDTH // 2 - 4 : WIDTH // 2 + 4]
    np.testing.assert_allclose(on_disk[middle], found.light[middle], atol=2e-3)
    on_wall = np.asarray(render(layers, lens_at(FAR_M), rays=64))
    corner = np.s_[3:8, 3:8]
    np.testing.assert_allclose(on_wall[corner], found.light[corner], atol=2e-3)


def test_what_is_behind_is_as_far_and_looks_like_the_wall():
    wall = np.full((HEIGHT, WIDTH, 3), 0.25, np.float32)
    _, depth = disk_scene(WIDTH, HEIGHT)
    near = depth == NEAR_M
    wall[near] = [0.9, 0.1, 0.1]
    parallax = float(CAMERA.focal_px) * 0.035 / (2 * 0.5)
    found = sheets(wall, 1 / depth, parallax, 1)
    border = found.border
    inner = np.s_[border : border + HEIGHT, border : border + WIDTH]
    behind, matte = found.behind[inner], found.matte
    assert (behind & near).sum() > 0.5 * near.sum()
    np.testing.assert_allclose(found.far[inner][behind], 1 / FAR_M, rtol=1e-3)
    # No halo: nothing of the disk's red is behind it.
    np.testing.assert_allclose(matte.far[inner][behind & near], 0.25, atol=2e-3)
    assert (matte.share[inner][near & ~found.band[inner]] == 1).all()


def test_a_blurred_foreground_over_an_even_wall_is_as_in_the_real_scene():
    """With the wall even, the guess behind the disk is right, so refocusing is exact up to edges."""
    _, depth = disk_scene(WIDTH, HEIGHT)
    light = np.full((HEIGHT, WIDTH, 3), 0.25, np.float32)
    light[depth == NEAR_M] = [0.9, 0.1, 0.1]
    scene = photo(light).scene(f_number=0.5)
    got = np.asarray(render(peel(scene, CAMERA, lens_at(FAR_M)), lens_at(FAR_M), rays=256))
    # The disk's coverage, convolved with the aperture: blur diameter 2 f E (1/0.5 - 1/2).
    radius = float(CAMERA.focal_px) * 0.035 / (2 * 0.5) * (1 / NEAR_M - 1 / FAR_M)
    near = (depth == NEAR_M).astype(float)
    offsets = np.linspace(-radius, radius, 41)
    shifts = [(a, b) for a in offsets for b in offsets if np.hypot(a, b) <= radius]
    cover = np.mean([shift(near, offset, order=1) for offset in shifts], axis=0)
    expected = cover[..., None] * [0.9, 0.1, 0.1] + (1 - cover[..., None]) * 0.25
    # Observed 2e-4 and 0.010, by the rays' noise; a hole or a halo would be 0.1 and more.
    assert np.abs(got - expected).mean() < 5e-4
    assert np.abs(got - expected).max() < 0.02


def test_energy_of_an_even_photograph_stays_to_the_border():
    depth = disk_scene(WIDTH, HEIGHT)[1]
    even = photo(np.full((HEIGHT, WIDTH, 3), 0.5, np.float32), depth)
    layers = peel(even.scene(f_number=0.5), CAMERA, lens_at(0.8))
    for distance in (NEAR_M, 0.8, FAR_M):
        got = np.asarray(render(layers, lens_at(distance), rays=32))
        np.testing.assert_allclose(got, 0.5, atol=2e-3)


def test_holes_are_an_object_of_their_own():
    measured = np.ones((HEIGHT, WIDTH), bool)
    measured[2:6, 2:9] = False
    scene = photo(measured=measured).scene(f_number=0.5)
    assert {SEEN, HOLES, GUESS} <= set(scene.objects)
    layers = peel(scene, CAMERA, lens_at(FAR_M))
    seen = np.asarray(layers.triangle[0])
    margin = layers.grid.margin
    face = seen[margin + 3, margin + 4]
    assert face in scene.objects[HOLES]


def test_slopes_are_joined_and_silhouettes_torn():
    ramp = np.tile(np.linspace(0.5, 2.0, 40), (5, 1))
    assert links(ramp, 60.0).across.all()
    step = np.where(np.arange(40) < 20, 0.5, 2.0)[None].repeat(5, axis=0)
    torn = ~links(step, 60.0).across
    assert torn[:, 19].all()
    assert torn.sum() == 5
    # A narrow lens cannot look behind: nothing is torn.
    assert links(step, 0.5).across.all()


def test_few_squares_where_a_surface_is_smooth():
    flat = photo(depth=np.full((HEIGHT, WIDTH), 1.0)).scene(f_number=0.5)
    # Four pixels of border all around; observed 0.17.
    assert len(flat.faces) < 0.25 * 2 * (WIDTH + 8) * (HEIGHT + 8)


def test_f_numbers_are_checked():
    with pytest.raises(ValueError, match="f_number is 0; expected a positive f-number"):
        photo().scene(f_number=0)


def test_behind_what_the_depth_map_missed_of_a_foreground_there_is_no_hole():
    """The disk is a pixel wider in the picture than in its depth: those pixels hide the wall, not nothing."""
    _, depth = disk_scene(WIDTH, HEIGHT)
    light = np.full((HEIGHT, WIDTH, 3), 0.75, np.float32)
    light[binary_dilation(depth == NEAR_M)] = 0.25
    found = dataclasses.replace(photo(light), edge_px=3)
    parallax = float(CAMERA.focal_px) * 0.035 / (2 * 0.5)
    made = sheets(light, 1 / depth, parallax, 3)
    whole = made.seen_behind & (made.matte.share == 1.0)
    assert whole.sum() > 20
    np.testing.assert_allclose(made.matte.far[whole], 0.75, atol=2e-3)
    got = np.asarray(render(peel(found.scene(f_number=0.5), CAMERA, lens_at(FAR_M)), lens_at(FAR_M), rays=64))
    # Nothing is darker than the disk; observed 0.2495, and 0.11 where pixels of the disk have nothing behind.
    assert got.min() > 0.245


def test_colours_overrule_depth_only_where_they_plainly_contradict_it():
    """Foreground of mixed greys before a wall of their mean: a pixel on the far side is theirs if far off."""
    light = np.full((9, 12, 3), 0.5, np.float32)
    light[:, :6] += np.where((np.indices((9, 6)).sum(axis=0) % 2)[..., None], 0.2, -0.2)
    near = np.zeros((9, 12), bool)
    near[:, :6] = True
    band, near_band = np.zeros_like(near), np.zeros_like(near)
    band[:, 5:7], near_band[:, 5] = True, True
    light[4, 6], light[2, 6] = 0.3, 0.505
    share = mattes(light, np.full_like(light, 0.5), near, band, near_band).share
    assert share[4, 6] == 1
    np.testing.assert_array_equal(share[[0, 2, 6, 8], 6], 0)
    np.testing.assert_array_equal(share[:, 5], 1)


def bars_at(width, height, levels):
    """Upright bar of `levels[0]` before level bars of `levels[1]`, four pixels each, before a wall."""
    disparity = np.full((height, width), levels[2])
    disparity[::8] = disparity[1::8] = disparity[2::8] = disparity[3::8] = levels[1]
    disparity[:, 30:34] = levels[0]
    colours = {levels[0]: [0.8, 0.1, 0.1], levels[1]: [0.1, 0.8, 0.1], levels[2]: [0.1, 0.1, 0.8]}
    return np.array([colours[value] for value in disparity.ravel()]).reshape(height, width, 3), disparity


def test_bars_that_stand_before_a_wall_go_on_behind_a_nearer_bar():
    """Their pixels are on the near side of the wall's tears and on the far side of the nearer bar's."""
    light, disparity = bars_at(64, 48, (2.0, 1.0, 0.25))
    found = sheets(light.astype(np.float32), disparity, 10.0, 1)
    inner = np.s_[found.border : found.border + 48, found.border : found.border + 64]
    behind, depth, colour = found.behind[inner], found.far[inner], found.matte.far[inner]
    rows = np.arange(8, 40)
    middle = rows[(rows % 8 == 1) | (rows % 8 == 2)]
    assert behind[middle, 31:33].all()
    # Observed 1.0 and green to 0.002.
    np.testing.assert_allclose(depth[middle, 31:33], 1.0, atol=0.02)
    green = np.broadcast_to([0.1, 0.8, 0.1], (len(middle), 2, 3))
    np.testing.assert_allclose(colour[middle, 31:33], green, atol=0.02)


def test_no_ray_passes_between_what_is_seen_and_a_soft_edge_of_depth():
    """Pixels of the disk's outline are anywhere between it and the wall, as in maps of phones."""
    _, depth = disk_scene(WIDTH, HEIGHT)
    near = depth == NEAR_M
    rim = binary_dilation(near) & ~near
    disparity = (1 / depth).astype(np.float32)
    disparity[rim] += 1.5 * np.random.default_rng(3).random(rim.sum(), dtype=np.float32)
    light = np.where(near[..., None], 0.05, 0.8).astype(np.float32).repeat(3, 2)
    light[rim] = 0.4
    found = dataclasses.replace(photo(light), disparity=disparity, edge_px=3)
    scene = found.scene(f_number=0.2)
    lens = lens_at(FAR_M, 0.2)
    lit = dataclasses.replace(scene, background=constant_background(1.0))
    seen = [np.asarray(render(peel(each, CAMERA, lens), lens, rays=64)) for each in (scene, lit)]
    # The share of rays that meet nothing at all; observed 0.0022, and 0.51 with the outline as it is.
    assert (seen[1] - seen[0])[4:-4, 4:-4].max() < 0.02


def test_slivers_take_the_depth_of_the_side_that_is_most_like_theirs():
    row = np.array([1.0, 1.0, 1.2, 1.9, 2.0, 2.0, 1.0, 1.0, 3.0, 3.0], np.float32)
    disparity = np.tile(row, (4, 1))
    got = without_slivers(disparity, 20.0)
    np.testing.assert_array_equal(got, np.tile([1, 1, 1, 2, 2, 2, 1, 1, 3, 3], (4, 1)))
    near, far = torn_sides(got, links(got, 20.0))
    assert not (near & far).any()
    # A slope is no silhouette, however steep, and a wire no sliver.
    slope = np.tile(np.linspace(1, 3, 10, dtype=np.float32), (4, 1))
    np.testing.assert_array_equal(without_slivers(slope, 20.0), slope)
    wire = np.where(np.arange(10) == 5, 2.0, 1.0).astype(np.float32) + np.zeros((4, 1), np.float32)
    np.testing.assert_array_equal(without_slivers(wire, 20.0), wire)


def test_lamps_do_not_go_on_behind_what_hides_them():
    light = np.full((HEIGHT, WIDTH, 3), 0.25, np.float32)
    _, depth = disk_scene(WIDTH, HEIGHT)
    light[HEIGHT // 2, WIDTH // 2 + 13] = 80.0
    disk = depth == NEAR_M
    assert not disk[HEIGHT // 2, WIDTH // 2 + 13]
    light[disk] = [0.9, 0.1, 0.1]
    found = sheets(light, 1 / depth, float(CAMERA.focal_px) * 0.035 / (2 * 0.5), 1)
    inner = np.s_[found.border : found.border + HEIGHT, found.border : found.border + WIDTH]
    # Observed 0.33, and 8.5 when the lamp is part of the boundary.
    assert found.matte.far[inner][disk & (found.behind & ~found.band)[inner]].max() < 0.5
    wide = np.full((40, 60, 3), 0.5)
    wide[5:25, 10:40] = 3.0
    np.testing.assert_array_equal(without_lamps(wide, 5), wide)
    wide[30, 50] = 9.0
    assert without_lamps(wide, 5)[30, 50].tolist() == [1.0, 1.0, 1.0]


def test_a_bright_sky_between_bars_is_no_lamp():
    light, disparity = np.full((100, 150, 3), 6.0, np.float32), np.full((100, 150), 0.1)
    light[:, ::8], light[:, 1::8] = 0.1, 0.1
    disparity[:, ::8], disparity[:, 1::8] = 1.0, 1.0
    found = sheets(light, disparity, 12.0, 1)
    hidden = found.matte.far[found.behind & ~found.seen_behind]
    # Observed 6.0, and 1.0 where what is narrow counts as lamps.
    assert np.median(hidden) == pytest.approx(6.0, abs=0.1)


def test_dark_guesses_are_right_beside_a_bright_sky():
    """Both are parts of one system, which has to be solved to what matters in the dark."""
    light, disparity = np.full((100, 200, 3), 0.1, np.float32), np.full((100, 200), 0.2)
    light[:, :100] = 50.0
    disparity[40:60, 40:60], light[40:60, 40:60] = 1.0, 0.5
    for left in range(120, 190, 6):
        disparity[:, left : left + 4], light[:, left : left + 4] = 1.0, 0.4
    found = sheets(light, disparity, 12.0, 1)
    part = np.zeros_like(found.behind)
    part[found.border + 5 : -found.border - 5, found.border + 125 : found.border + 185] = True
    hidden = found.matte.far[found.behind & ~found.band & part]
    # Observed 0.100 to 0.154; to 0.26 with a hundred times the tolerance.
    assert hidden.min() > 0.09
    assert hidden.max() < 0.2


def test_lamps_seen_through_twigs_are_as_far_as_their_brightest_part():
    """A twig one pixel wide crosses a lamp: its pixel is brighter than white, by the lamp's light."""
    light = np.full((HEIGHT, WIDTH, 3), 0.25, np.float32)
    disparity = np.full((HEIGHT, WIDTH), 0.5)
    disparity[:, 30] = 2.0
    light[:, 30] = [0.1, 0.2, 0.05]
    light[20:23, 28:33] = 60.0
    light[20:23, 30] = 20.0
    found = sheets(light, disparity, 12.0, 1)
    inner = np.s_[found.border : found.border + HEIGHT, found.border : found.border + WIDTH]
    near, share = found.matte.near[inner], found.matte.share[inner]
    # Observed 0, and 20 where a twig's own pixels count as much as others.
    assert (near[20:23, 30].max(axis=-1) * share[20:23, 30]).max() < 1.0


def test_beyond_the_frame_the_mirror_image_fades_to_its_mean():
    texture = np.random.default_rng(0).uniform(0, 1, (120, 160, 3)).astype(np.float32)
    wide = extended(texture, 40)
    np.testing.assert_array_equal(wide[40:-40, 40:-40], texture)
    spread = [wide[40 - away, 40:-40].std() for away in (1, 4, 16, 40)]
    # Observed 0.11, 0.025, 0.008 and 0.004; 0.29 inside.
    assert spread[0] < 0.2
    assert (np.diff(spread) < 0).all()
    assert abs(wide[:40, 40:-40].mean() - 0.5) < 0.02
    np.testing.assert_allclose(extended(np.full((9, 7, 3), 0.3), 7), 0.3, rtol=1e-6)
