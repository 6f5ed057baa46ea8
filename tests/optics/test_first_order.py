"""First-order data and Seidel sums against formulas and against traced rays."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import GLASS, all_lenses, asphere, biconvex

from focusjax.optics import (
    PRESETS,
    abbe_number,
    air,
    film_distance,
    first_order,
    index_glass,
    lens_preset,
    line,
    make_prescription,
    opened_to,
    seidel_sums,
    singlet,
    sphere,
    trace,
    with_focal_length,
)

LENSES = all_lenses()
SINGLETS = [name for name in LENSES if name not in PRESETS]


def test_the_thick_lensmakers_equation():
    """1 / f = (n - 1) (1 / R1 - 1 / R2 + (n - 1) d / (n R1 R2)), principal planes at f (n - 1) d / (n R)."""
    n, r1, r2, d = float(GLASS.index(line())), 30.0, -45.0, 7.0
    seen = first_order(singlet(r1, r2, thickness=d, semi_diameter=8, glass=GLASS))
    f = 1 / ((n - 1) * (1 / r1 - 1 / r2 + (n - 1) * d / (n * r1 * r2)))
    assert float(seen.focal_length) == pytest.approx(f, rel=1e-13)
    assert float(seen.front_principal_plane) == pytest.approx(-f * (n - 1) * d / (n * r2), rel=1e-12)
    assert float(seen.rear_principal_plane) == pytest.approx(-f * (n - 1) * d / (n * r1), rel=1e-12)
    assert float(seen.f_number) == pytest.approx(f / 16, rel=1e-13)


@pytest.mark.parametrize(
    ("name", "digits"),
    [
        ("planar_us583336_f4.5_1897", 49.39),
        ("gauss_jp62087922_f1.8_1987", 51.42),
        ("retrofocus_35mm_f2", 35.51),
        ("cooke_triplet_50mm_f4", 49.88),
        ("biogon_us2721499_f4.5_1955", 21.01),
        ("gauss_us2673491_f2_1954", 50.01),
        ("sonnar_us1998704_f2_1935", 85.03),
    ],
)
def test_focal_lengths_of_the_shipped_lenses(name, digits):
    assert round(float(first_order(LENSES[name]).focal_length), 2) == digits


# The patents' tables: radius, distance to the next surface, n_D and Abbe number of what is between.
# CREDITS.md says who read them.
BIOGON = (
    (109.14, 3.7, 1.5038, 66.7),
    (52.63, 13.2),
    (110.25, 3.7, 1.48697, 70.3),
    (50.72, 35.0),
    (56.24, 29.3, 1.7205, 50.3),
    (25.37, 13.3, 1.60739, 59.5),
    (-194.92, 4.7),
    (-252.7, 2.8, 1.56993, 57.5),
    (30.59, 23.7, 1.625, 53.3),
    (-25.51, 18.2, 1.71966, 29.3),
    (-57.38, 39.0),
    (-40.15, 9.8, 1.642, 58.1),
    (-102.64, 0.0),
)
TRONNIER = (
    (0.5895, 0.0752, 1.67125, 47.1),
    (1.6966, 0.0024),
    (0.3855, 0.0805, 1.67125, 47.1),
    (0.8154, 0.0655, 1.69842, 30.1),
    (0.255, 0.10932 + 0.09482),
    (-0.2899, 0.0236, 1.60266, 38.4),
    (0.8154, 0.1213, 1.65953, 57.0),
    (-0.4077, 0.0038),
    (8.7413, 0.0644, 1.7174, 48.1),
    (-0.7946, 0.0),
)
SONNAR = (
    (57.0, 8.0, 1.6185, 60.5),
    (146.3, 0.4),
    (36.2, 10.0, 1.6711, 47.3),
    (110.0, 6.0, 1.4645, 65.7),
    (-300.0, 6.8, 1.689, 31.2),
    (23.7, 15.0),
    (200.0, 2.0, 1.5647, 55.8),
    (30.7, 12.0, 1.6711, 47.3),
    (-152.64, 0.0),
)


@pytest.mark.parametrize(
    ("name", "printed", "scale", "focal_length", "f_number", "back"),
    [
        ("biogon_us2721499_f4.5_1955", BIOGON, 0.21, 100.0, 4.5, None),
        ("gauss_us2673491_f2_1954", TRONNIER, 50.0, 1.0, 2.0, 0.71436),
        ("sonnar_us1998704_f2_1935", SONNAR, 0.85, 100.0, 2.0, None),
    ],
)
def test_lenses_from_patents_do_what_these_say(name, printed, scale, focal_length, f_number, back):
    """The patent's numbers by a y-nu trace in plain floats, its focal length, and the shipped lens."""
    height, slope, before = 1.0, 0.0, 1.0
    for radius, gap, *glass in printed:
        after = glass[0] if glass else 1.0
        # Reduced: the index times the angle.
        slope -= height * (after - before) / radius
        before = after
        height += gap * slope / after
    # Observed: 0.06 % of what the patents state.
    assert -1 / slope == pytest.approx(focal_length, rel=1e-3)
    seen = first_order(LENSES[name])
    # Observed: 2e-7, and 4e-6 where the patent's numbers were rounded once they were scaled.
    assert float(seen.focal_length) == pytest.approx(-scale / slope, rel=1e-5)
    assert float(seen.back_focal_distance) == pytest.approx(-scale * height / slope, rel=1e-5)
    assert float(seen.f_number) == pytest.approx(f_number, rel=1e-5)
    if back is not None:
        # Observed: 1.1e-4.
        assert float(seen.back_focal_distance) == pytest.approx(scale * back, rel=3e-4)
    glasses = [each for each in LENSES[name].glasses if float(each.index(line())) > 1.0]
    numbers = [each for _, _, *each in printed if each]
    found = [(float(each.index(line())), float(abbe_number(each))) for each in glasses]
    np.testing.assert_allclose(found, numbers, rtol=1e-6)


def ray_height(lens, y, tangent, place):
    """Height in mm at a place behind the last vertex of a ray from height `y` at the first vertex."""
    way = jnp.stack([jnp.zeros_like(tangent), tangent, jnp.ones_like(tangent)])
    start = jnp.stack([jnp.zeros_like(y), y - 30.0 * tangent, jnp.asarray(-30.0)])
    ray = trace(lens, lens.indices(line()), start, way / jnp.sqrt(way @ way))
    ahead = lens.vertices()[-1] + place - ray.position[2]
    return ray.position[1] + ray.direction[1] / ray.direction[2] * ahead


@eqx.filter_jit
def ray_heights(lens, *given):
    """Of several rays at once."""
    return jax.vmap(lambda *each: ray_height(lens, *each))(*map(jnp.asarray, given))


@pytest.mark.parametrize("name", [*SINGLETS, "retrofocus_35mm_f2"])
def test_traced_rays_near_the_axis_obey_first_order(name):
    """Of every kind of surface, and of one lens of many; rays and data of all shipped ones: Optiland's."""
    lens = LENSES[name]
    seen = first_order(lens)
    pupil, back = float(seen.entrance_pupil), float(seen.back_focal_distance)
    near, scale = map(float, film_distance(lens, lens.indices(line()), jnp.asarray(1 / 800.0)))
    # From a point of the plane 800 mm before the entrance pupil, through the pupil and elsewhere.
    shares = np.array([0.0, 1e-3])
    slopes = (shares - 1e-5 * 800.0) / 800.0
    axial, oblique, *heights = np.asarray(
        ray_heights(
            lens,
            [1e-5, -1e-5 * pupil, *(shares - slopes * pupil)],
            [0.0, 1e-5, *slopes],
            [back, back, near, near],
        )
    )
    # The rest is of the third order.
    assert axial == pytest.approx(0.0, abs=1e-9)
    assert oblique == pytest.approx(1e-5 * float(seen.focal_length), rel=1e-8)
    assert heights[0] == pytest.approx(heights[1], abs=1e-9)
    assert heights[0] == pytest.approx(-1e-5 * scale, rel=1e-6)


def test_scaling_and_stopping_down():
    lens = opened_to(with_focal_length(lens_preset("cooke_triplet_50mm_f4"), 100.0), 8.0)
    seen = first_order(lens)
    assert float(seen.focal_length) == pytest.approx(100.0)
    assert float(seen.f_number) == pytest.approx(8.0)


def test_lenses_that_form_no_image_and_openings_that_are_none():
    with pytest.raises(ValueError, match=r"focal length of -48.*only a converging lens"):
        with_focal_length(singlet(-50, 50, thickness=2, semi_diameter=5, glass=GLASS), 50)
    n = float(GLASS.index(line()))
    # Concentric enough: the thickness that makes two convex surfaces a telescope.
    telescope = singlet(20, -20, thickness=40 * n / (n - 1), semi_diameter=5, glass=GLASS)
    with pytest.raises(ValueError, match="afocal"):
        with_focal_length(telescope, 50)
    with pytest.raises(ValueError, match="focal length is -5 mm"):
        with_focal_length(biconvex(), -5)
    with pytest.raises(ValueError, match=r"biconvex opens to f/2.73 at most; f/1.4 is beyond that"):
        opened_to(biconvex(), 1.4)
    with pytest.raises(ValueError, match="f-number is 0"):
        opened_to(biconvex(), 0)


@pytest.mark.parametrize("name", ["biconvex", "asphere", "planar_us583336_f4.5_1897"])
def test_the_spherical_sum_is_that_of_traced_rays(name):
    """At the paraxial focus a ray of share r of the pupil lands 4 W040 r^3 / u' off, to the fifth order."""
    lens = LENSES[name]
    seen = first_order(lens)
    w040 = float(seidel_sums(lens, field=0.0).wavefront()["W040"])
    share = 0.05
    height = jnp.asarray(share) * seen.entrance_pupil_radius
    landed = float(ray_height(lens, height, jnp.asarray(0.0), seen.back_focal_distance))
    slope = float(seen.entrance_pupil_radius / seen.focal_length)
    # The rest is of the fifth order.
    assert landed == pytest.approx(-4 * w040 * share**3 / slope, rel=1e-2)


@pytest.mark.parametrize("name", ["biconvex", "gauss_jp62087922_f1.8_1987"])
def test_sums_of_colour_are_the_shift_of_focus_and_image(name):
    lens = LENSES[name]
    seen, field = first_order(lens), 0.1
    wave = seidel_sums(lens, field=field).wavefront()
    blue, red = (first_order(lens, line(k)) for k in ("F", "C"))
    shift = float(blue.back_focal_distance - red.back_focal_distance)
    # dW at the rim = n' u'^2 / 2 times the shift; thick lenses' dispersion is not quite infinitesimal: 2 %.
    slope = float(seen.entrance_pupil_radius / seen.focal_length)
    assert float(wave["W020_colour"]) == pytest.approx(-(slope**2) / 2 * shift, rel=0.03)


def test_bending_a_thin_singlet_for_least_spherical_aberration():
    """The textbook's shape for far things, 2 (n^2 - 1) / (n + 2), from the derivatives of W040."""
    n = 1.5
    glass, power, radius = index_glass(n), 1 / 100.0, 5.0

    def w040(shape):
        c1 = power * (shape + 1) / (2 * (n - 1))
        c2 = power * (shape - 1) / (2 * (n - 1))
        lens = make_prescription([sphere(0.0), sphere(0.0)], [0.0, 0.0], [radius] * 2, [glass, air()], stop=0)
        bent = tuple(sphere(c) for c in (c1, c2))
        lens = type(lens)(bent, lens.thicknesses, lens.semi_diameters, lens.glasses, lens.stop)
        return seidel_sums(lens, field=0.0).wavefront()["W040"]

    slope = jax.grad(w040)
    curve = jax.grad(slope)(jnp.asarray(0.0))
    # W040 is a parabola in the shape: one Newton step.
    best = -float(slope(jnp.asarray(0.0)) / curve)
    assert best == pytest.approx(2 * (n**2 - 1) / (n + 2), rel=1e-12)
    assert float(curve) > 0


def test_an_asphere_without_polynomial_has_the_sums_of_its_conic():
    lens = asphere()
    conic = LENSES["conic"]
    bare = np.asarray(seidel_sums(conic, field=0.2).coma)
    # The stop is at the first surface, so its figure changes S_I only.
    np.testing.assert_allclose(np.asarray(seidel_sums(lens, field=0.2).coma), bare, rtol=1e-12)
