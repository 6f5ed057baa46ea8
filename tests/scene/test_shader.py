"""Radiance against closed forms: Lambert, Phong, inverse squares, mip levels; finite gradients."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.scene import directional_light, make_object, make_scene, point_light
from focusjax.scene._atlas import make_atlas, pyramid

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = (SQUARE[:, :2] + 1) / 2
ORIGIN = (0.5, 0.0, 0.5)  # weights of face 0 at the middle of the square


def radiance(scene, eye, *, weights=ORIGIN, triangle=0, extent=1e-3):
    shader = scene.shader(jnp.asarray(eye, dtype=float))
    return shader(jnp.asarray(triangle), jnp.asarray(weights, dtype=float), jnp.asarray(extent, dtype=float))


def square(**arguments):
    return make_object("square", SQUARE, FACES, **arguments)


@pytest.mark.parametrize("degrees", [0.0, 35.0, 80.0, 100.0])
def test_lambert_cosine(degrees):
    angle = np.deg2rad(degrees)
    light = directional_light((-np.sin(angle), 0, -np.cos(angle)), (2.0, 1.0, 0.5))
    albedo = np.array([0.2140411, 0.0, 1.0])  # of the sRGB colour below
    scene = make_scene([square(colour=(0.5, 0, 1), emission=(0, 7, 0))], lights=[light], ambient=0.1)
    expected = albedo * (0.1 + np.array([2, 1, 0.5]) * max(np.cos(angle), 0)) + [0, 7, 0]
    np.testing.assert_allclose(radiance(scene, (0, 0, 3)), expected, atol=1e-6)


def test_both_sides_are_lit_as_the_eye_sees_them():
    scene = make_scene([square()], lights=[directional_light((0, 0, -1), 1.0)])
    np.testing.assert_allclose(radiance(scene, (0, 0, 3)), 0.8)
    # From behind, the light falls on the far side.
    np.testing.assert_allclose(radiance(scene, (0, 0, -3)), 0.0)
    lit_behind = make_scene([square()], lights=[directional_light((0, 0, 1), 1.0)])
    np.testing.assert_allclose(radiance(lit_behind, (0, 0, -3)), 0.8)


def test_winding_against_stored_normals_does_not_matter():
    item = square()
    turned = dataclasses.replace(item, faces=item.faces[:, ::-1].copy())
    for one in (item, turned):
        scene = make_scene([one], lights=[directional_light((0, 0, -1), 1.0)])
        np.testing.assert_allclose(radiance(scene, (0, 0, 3)), 0.8)


def test_smooth_outline_is_not_flipped():
    # A face seen at a grazing angle whose shading normal points slightly away from the eye.
    item = square()
    away = np.tile([0.2, 0.0, 0.98], (len(item.normals), 1))
    item = dataclasses.replace(item, normals=away / np.linalg.norm(away[0]))
    scene = make_scene([item], lights=[directional_light((0, 0, -1), 1.0)])
    eye = (-3.0, 0.0, 0.1)  # above the face, below the shading normal's horizon
    np.testing.assert_allclose(radiance(scene, eye), 0.8 * 0.98 / np.hypot(0.2, 0.98), atol=1e-12)


@pytest.mark.parametrize("shininess", [1.0, 20.0])
def test_phong_lobe(shininess):
    eye_angle, light_angle = np.deg2rad(50), np.deg2rad(-30)
    light = directional_light((-np.sin(light_angle), 0, -np.cos(light_angle)), 2.0)
    item = square(colour=(0, 0, 0), specular=(0.5, 0.25, 0), shininess=shininess)
    scene = make_scene([item], lights=[light])
    eye = (4 * np.sin(eye_angle), 0, 4 * np.cos(eye_angle))
    # The mirrored light leaves at 30 degrees, 20 degrees from the eye.
    expected = np.array([0.5, 0.25, 0]) * 2 * np.cos(np.deg2rad(20)) ** shininess
    np.testing.assert_allclose(radiance(scene, eye), expected, atol=1e-12)
    behind = dataclasses.replace(scene, lights=(directional_light((0, 0, 1), 1.0),))
    np.testing.assert_allclose(radiance(behind, eye), 0.0)


def test_point_light_falls_off_with_the_square():
    for distance in (0.5, 2.0):
        scene = make_scene([square()], lights=[point_light((0, 0, distance), (1, 2, 3))])
        expected = 0.8 * np.array([1, 2, 3]) / distance**2
        np.testing.assert_allclose(radiance(scene, (0, 1, 3)), expected, rtol=1e-12)
    aside = make_scene([square()], lights=[point_light((3, 0, 4), 1.0)])
    np.testing.assert_allclose(radiance(aside, (0, 0, 3)), 0.8 * (4 / 5) / 25, rtol=1e-12)


def test_unlit_shows_albedo_and_emission():
    scene = make_scene(
        [square(vertex_colours=np.tile([0.5, 0.25, 1.0], (4, 1)), emission=(0, 0, 9), specular=1.0)],
        lights=[point_light((0, 0, 1), 100.0)],
        ambient=1.0,
        unlit=True,
    )
    np.testing.assert_allclose(radiance(scene, (0, 0, 3)), [0.5, 0.25, 10.0])


def test_vertex_colours_are_interpolated():
    colours = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]], dtype=float)
    scene = make_scene([square(vertex_colours=colours)], unlit=True)
    np.testing.assert_allclose(radiance(scene, (0, 0, 3), weights=(0.2, 0.5, 0.3)), [0.2, 0.5, 0.3])


def checker(size: int) -> np.ndarray:
    board = (np.add.outer(np.arange(size), np.arange(size)) % 2).astype(np.float32)
    return np.repeat(board[..., None], 3, axis=2)


def test_texture_orientation():
    # Top row red, green; bottom row blue, white; v upwards.
    picture = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]], dtype=np.float32)
    scene = make_scene([square(uv=UV, texture=picture)], unlit=True)
    # The middles of the texels are a quarter of the square from its edges.
    bottom_left = radiance(scene, (0, 0, 3), weights=(0.75, 0.0, 0.25))
    np.testing.assert_allclose(bottom_left, [0, 0, 1], atol=1e-12)
    bottom_right = radiance(scene, (0, 0, 3), weights=(0.25, 0.5, 0.25))
    np.testing.assert_allclose(bottom_right, [1, 1, 1], atol=1e-12)
    top_left = radiance(scene, (0, 0, 3), triangle=1, weights=(0.25, 0.25, 0.5))
    np.testing.assert_allclose(top_left, [1, 0, 0], atol=1e-12)


def test_extent_chooses_the_mip_level():
    # The square is 2 m wide, so a texel of the 64 x 64 checker is 1/32 m.
    scene = make_scene([square(uv=UV, texture=checker(64))], unlit=True)
    fine = [radiance(scene, (0, 0, 3), weights=(0.5 - t, t, 0.5), extent=1e-4)[0] for t in (0.25, 0.2578125)]
    # Halfway between texel middles a checker is grey at any level, at one it is black or white.
    np.testing.assert_allclose(fine, [0.5, 0.5], atol=1e-9)
    shift = 0.5 / 64
    weights = (0.5 - shift, 0.0, 0.5 + shift)
    values = [
        float(radiance(scene, (0, 0, 3), weights=weights, extent=e / 32)[0]) for e in (0.01, 1, 2**0.5, 2, 64)
    ]
    # Level 0 shows the texel; half a level on is halfway to the mean; from two texels on, the mean.
    np.testing.assert_allclose(values, [1, 1, 0.75, 0.5, 0.5], atol=1e-6)


def test_textures_repeat_and_do_not_bleed_into_each_other():
    red = np.zeros((5, 3, 3), dtype=np.float32)
    red[..., 0] = 1.0
    atlas = make_atlas([red, checker(4)])
    uv = jnp.asarray(np.random.default_rng(0).uniform(-3, 3, (50, 2)))
    look_up = jax.jit(jax.vmap(atlas, in_axes=(None, 0, None)))
    for footprint in (0.0, 1.7, 1e6):
        colour = look_up(jnp.asarray(1), uv, jnp.asarray(footprint))
        np.testing.assert_allclose(colour, np.tile([1, 0, 0], (50, 1)), atol=1e-6)
        again = look_up(jnp.asarray(2), uv, jnp.asarray(footprint))
        shifted = look_up(jnp.asarray(2), uv + jnp.asarray([[2.0, -5.0]]), jnp.asarray(footprint))
        np.testing.assert_allclose(again, shifted, atol=1e-6)
    np.testing.assert_allclose(atlas(jnp.asarray(0), jnp.zeros(2), jnp.asarray(3.0)), 1.0)


@pytest.mark.parametrize("size", [(1, 1), (8, 8), (5, 3), (1, 7), (6, 10)])
def test_every_level_keeps_the_mean(size):
    picture = np.random.default_rng(1).random((*size, 3)).astype(np.float32)
    levels = pyramid(picture)
    assert levels[-1].shape == (1, 1, 3)
    for level in levels:
        # Observed: 2e-7 relative, float32 rounding.
        np.testing.assert_allclose(level.mean(axis=(0, 1)), picture.mean(axis=(0, 1)), rtol=2e-6)


@pytest.fixture(name="full")
def full_scene():
    """Everything at once, with a second object that is untextured and has a degenerate triangle."""
    flat = make_object(
        "flat", [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 3]], emission=3.0
    )
    item = square(
        uv=UV, texture=checker(8), specular=0.4, shininess=10.0, vertex_colours=np.ones((4, 3)) * 0.5
    )
    lights = [directional_light((0.2, -1, -1), 0.7), point_light((0.3, 0.4, 1), (1, 0.9, 0.8))]
    return make_scene([item, flat], lights=lights, ambient=0.2)


def test_gradients_match_differences(full):
    shader = full.shader(jnp.asarray([0.5, 0.2, 3.0]))

    @jax.jit
    def value(parameters):
        colour, intensity, position = parameters
        changed = eqx.tree_at(
            lambda s: (s.base_colour[0], s.lights[1].intensity, s.lights[1].position),
            shader,
            (colour, intensity, position),
        )
        weights = jnp.asarray([0.3, 0.45, 0.25])
        return changed(jnp.asarray(0), weights, jnp.asarray(0.3)).sum()

    start = (shader.base_colour[0], shader.lights[1].intensity, shader.lights[1].position)
    gradient = jax.grad(value)(start)
    step = 1e-6
    for part, slope in enumerate(gradient):
        for index in range(slope.size):
            ahead, behind = (
                tuple(p.at[index].add(sign * step) if n == part else p for n, p in enumerate(start))
                for sign in (1, -1)
            )
            difference = (value(ahead) - value(behind)) / (2 * step)
            # Observed: 4e-10.
            np.testing.assert_allclose(slope[index], difference, atol=1e-7)


def test_awkward_samples_stay_finite_with_their_gradients(full):
    @eqx.filter_jit
    def look(shader, eyes, triangles, extents):
        def one(eye, triangle, extent):
            moved = eqx.tree_at(lambda s: s.eye, shader, eye)
            return eqx.filter_value_and_grad(lambda s: s(triangle, jnp.asarray(ORIGIN), extent).sum())(moved)

        return jax.vmap(one)(eyes, triangles, extents)

    # An eye and a lamp in the surface, no triangle, a triangle without area, extremes of the extent.
    in_surface = dataclasses.replace(full, lights=(full.lights[0], point_light((0, 0, 0), 1.0)))
    eyes = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    cases = [(eye, t, e) for eye in eyes for t in (-1, 0, 2) for e in (0.0, 1e30)]
    arguments = [jnp.asarray(np.array(values)) for values in zip(*cases, strict=True)]
    for leaf in jax.tree.leaves(look(in_surface.shader(eyes[0]), *arguments)):
        assert bool(jnp.all(jnp.isfinite(leaf)))


def test_float32_agrees_with_float64(full):
    shader = full.shader(jnp.asarray([0.5, 0.2, 3.0]))
    low = jax.tree.map(lambda leaf: leaf.astype(jnp.float32) if leaf.dtype == jnp.float64 else leaf, shader)
    weights = jnp.asarray([0.3, 0.45, 0.25])
    single = eqx.filter_jit(low)(
        jnp.asarray(0), weights.astype(jnp.float32), jnp.asarray(0.3, dtype=jnp.float32)
    )
    assert single.dtype == jnp.float32
    # Observed: 1e-6 relative.
    np.testing.assert_allclose(single, shader(jnp.asarray(0), weights, jnp.asarray(0.3)), rtol=1e-5)


def test_many_samples_at_once_equal_one_by_one(full):
    shader = full.shader(jnp.asarray([0.5, 0.2, 3.0]))
    rng = np.random.default_rng(2)
    triangles, weights = jnp.asarray(rng.integers(0, 3, 5)), jnp.asarray(rng.dirichlet([1, 1, 1], 5))
    extents = jnp.asarray(rng.uniform(0.0, 1.0, 5))
    one = eqx.filter_jit(shader)
    together = jax.jit(lambda s, *a: jax.vmap(s)(*a))(shader, triangles, weights, extents)
    alone = jnp.stack([one(*sample) for sample in zip(triangles, weights, extents, strict=True)])
    np.testing.assert_allclose(together, alone, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: directional_light((0, 0, 0)), "direction of a directional light is zero"),
        (
            lambda: directional_light((0, np.nan, 0)),
            "direction of a directional light is .*; expected three finite",
        ),
        (lambda: directional_light((0, -1, 0), -1.0), "colour of a directional light is -1"),
        (lambda: point_light((0, 0), 1.0), "position of a point light is .*; expected three finite"),
        (
            lambda: point_light((0, 0, 0), (1, 2)),
            "intensity of a point light is .*; expected one number or three",
        ),
    ],
)
def test_bad_lights_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
