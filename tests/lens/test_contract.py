"""What every lens owes the rest of the program, whichever lens it is."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients

from focusjax.geometry import Camera, LensRay, look_at
from focusjax.lens import (
    AbstractAperture,
    AbstractLens,
    Disk,
    FocalSurfaceLens,
    ThinLens,
    focal_surface,
    focal_surface_lens,
    polygon,
)

FOCUS = 0.5
FILM_POINTS = [(20.0, 15.0), (3.2, 27.9)]
DISPARITIES = [0.0, 0.2, 0.49, 0.51, 1.7]
"""On both sides of the focus, and at infinity."""


def thin(aperture: AbstractAperture, focus: float = FOCUS, radius: float = 0.04) -> ThinLens:
    return ThinLens(jnp.array(focus), jnp.array(radius), aperture)


def surfaced(radius: float = 0.04) -> FocalSurfaceLens:
    """Focus at about the same disparity everywhere, so that it orders `DISPARITIES` alike."""
    places = [(5.0, 5.0), (33.0, 12.0), (18.0, 26.0)]
    surface = focal_surface(places, [0.492, 0.5, 0.508], aperture_scale=[0.6, 1.0, 1.3], basis="affine")
    return focal_surface_lens(surface, CAMERA, thin(polygon(5, rotation=0.3), radius=radius))


def at_film(lens: AbstractLens, camera: Camera, film: jnp.ndarray) -> ThinLens:
    """The thin lens that a film point looks through."""
    return lens if isinstance(lens, ThinLens) else lens.thin_lens_at(camera, film)


CAMERA = look_at((1.0, 0.5, 2.0), (0.0, 0.0, 0.0), width=40, height=30, field_of_view=0.7)
LENSES = {
    "thin, disk": thin(Disk()),
    "thin, 5 straight blades": thin(polygon(5, rotation=0.3)),
    "thin, 5 bulging blades": thin(polygon(5, rotation=0.3, roundness=0.5)),
    "thin, 5 round blades": thin(polygon(5, rotation=0.3, roundness=1.0)),
    "thin, focused on infinity": thin(polygon(5), focus=0.0),
    "focal surface": surfaced(),
}
PINHOLES = {
    "thin, disk": thin(Disk(), radius=0.0),
    "thin, blades": thin(polygon(5), radius=0.0),
    "focal surface": surfaced(0.0),
}

every_lens = pytest.mark.parametrize("lens", [pytest.param(lens, id=name) for name, lens in LENSES.items()])
every_pinhole = pytest.mark.parametrize(
    "lens", [pytest.param(lens, id=name) for name, lens in PINHOLES.items()]
)


@pytest.fixture(scope="module")
def camera() -> Camera:
    return CAMERA


def square() -> jnp.ndarray:
    """Samples of the unit square, its edges and the blades' corners among them."""
    side = jnp.linspace(0.0, 1.0, 61)
    return jnp.stack(jnp.meshgrid(side, side), axis=-1).reshape(-1, 2)


@eqx.filter_jit
def all_rays(lens: AbstractLens, camera: Camera, film: jnp.ndarray) -> tuple[jnp.ndarray, LensRay]:
    pupil = jax.vmap(lens.pupil_point)(square())
    return pupil, jax.vmap(lambda v: lens.ray(camera, film, v))(pupil)


@every_lens
@pytest.mark.parametrize("film", FILM_POINTS)
def test_rays_fill_the_circle_of_confusion(lens: AbstractLens, camera: Camera, film):
    film = jnp.array(film)
    pupil, rays = all_rays(lens, camera, film)
    for w in map(jnp.array, DISPARITIES):
        blur = float(lens.blur(camera, film, w))
        centre, radius = lens.footprint(camera, film, w)
        landed = np.asarray(rays.a + rays.b * w)
        away = np.linalg.norm(landed - np.asarray(centre), axis=1)
        assert away.max() == pytest.approx(abs(blur) / 2, abs=1e-9)
        assert float(radius) == pytest.approx(abs(blur) / 2, abs=1e-9)
        # Positive blur is behind the focus, where rays have crossed over.
        np.testing.assert_allclose(landed, np.asarray(film) - blur / 2 * np.asarray(pupil), atol=1e-9)


@every_lens
def test_blur_is_positive_behind_the_focus_and_linear_in_disparity(lens: AbstractLens, camera: Camera):
    film = jnp.array(FILM_POINTS[0])
    there = at_film(lens, camera, film)
    focus = float(there.focus_disparity)
    blurs = np.array([float(lens.blur(camera, film, jnp.array(w))) for w in DISPARITIES])
    assert (np.sign(blurs) == np.sign(focus - np.array(DISPARITIES))).all()
    np.testing.assert_allclose(np.diff(blurs) / np.diff(DISPARITIES), -2 * float(there.parallax(camera)))


@every_lens
@pytest.mark.parametrize("film", FILM_POINTS)
def test_rays_meet_in_focus(lens: AbstractLens, camera: Camera, film):
    _, rays = all_rays(lens, camera, jnp.array(film))
    met = rays.a + rays.b * at_film(lens, camera, jnp.array(film)).focus_disparity
    np.testing.assert_allclose(met, np.broadcast_to(film, met.shape), atol=1e-12)


@every_lens
def test_the_middle_ray_is_the_pinhole_ray(lens: AbstractLens, camera: Camera):
    ray = lens.ray(camera, camera.principal_point, jnp.zeros(2))
    np.testing.assert_array_equal(ray.a, camera.principal_point)
    np.testing.assert_array_equal(ray.b, [0.0, 0.0])


@every_lens
def test_rays_cross_the_lens_at_the_pupil_point(lens: AbstractLens, camera: Camera):
    """b is the crossing point times the focal length, and never above the parallax."""
    pupil, rays = all_rays(lens, camera, jnp.array(FILM_POINTS[1]))
    radius = at_film(lens, camera, jnp.array(FILM_POINTS[1])).aperture_radius
    expected = np.asarray(camera.focal_px * radius * pupil)
    np.testing.assert_allclose(rays.b, expected, atol=1e-12)
    widest = np.linalg.norm(rays.b, axis=1).max()
    assert widest <= float(lens.parallax(camera)) * (1 + 1e-12)


@every_lens
def test_bounds_hold_all_over_the_picture(lens: AbstractLens, camera: Camera):
    """Reach and parallax bound every film point; disks of a pixel's corners bound those within."""
    films = jnp.array(np.random.default_rng(1).uniform((0, 0), (40, 30), (200, 2)))
    radius = jax.jit(jax.vmap(lambda p, w: lens.footprint(camera, p, w)[1], in_axes=(0, None)))
    for w in map(jnp.array, DISPARITIES):
        here = np.asarray(radius(films, w))
        corners = [radius(jnp.floor(films) + jnp.array([[x, y]]), w) for x in (0.0, 1.0) for y in (0.0, 1.0)]
        assert (here <= np.max(corners, axis=0) + 1e-12).all()
        assert here.max() <= float(lens.reach(camera, w)) + 1e-12
    rims = [jnp.linalg.norm(all_rays(lens, camera, film)[1].b, axis=1).max() for film in films[:5]]
    assert max(map(float, rims)) <= float(lens.parallax(camera)) * (1 + 1e-12)


@every_lens
def test_weights_integrate_to_one(lens: AbstractLens, camera: Camera):
    _, rays = all_rays(lens, camera, jnp.array(FILM_POINTS[1]))
    assert float(rays.weight.mean()) == pytest.approx(1.0)


def seen(lens: AbstractLens, camera: Camera, sample: jnp.ndarray) -> tuple:
    """All that a lens answers."""
    film, w = jnp.array(FILM_POINTS[1]), jnp.array(1.3)
    ray = lens.ray(camera, film, lens.pupil_point(sample))
    return ray.a, ray.b, ray.weight, lens.blur(camera, film, w), lens.footprint(camera, film, w)


@every_lens
def test_gradients_match_differences(lens: AbstractLens, camera: Camera):
    """With respect to focus, aperture radius, roundness, rotation, camera, and the place on the pupil."""
    # Observed: 2e-10 of the largest.
    check_gradients(seen, lens, camera, jnp.array([0.31, 0.62]))
    check_gradients(seen, lens, camera, jnp.array([0.93, 0.12]))


@every_pinhole
def test_a_closed_aperture_is_a_pinhole(lens: AbstractLens, camera: Camera):
    for film in map(jnp.array, FILM_POINTS):
        _, rays = all_rays(lens, camera, film)
        for w in DISPARITIES:
            landed = rays.a + rays.b * w
            np.testing.assert_array_equal(landed, np.broadcast_to(film, landed.shape))
            assert float(lens.blur(camera, film, jnp.array(w))) == 0.0


@pytest.mark.parametrize(
    "lens",
    [
        *(pytest.param(lens, id=f"pinhole {name}") for name, lens in PINHOLES.items()),
        *(pytest.param(lens, id=name) for name, lens in LENSES.items()),
        pytest.param(thin(Disk(), focus=1.3), id="point in focus"),
    ],
)
def test_gradients_are_finite_where_formulas_are_delicate(lens: AbstractLens, camera: Camera):
    """Closed aperture, focus on infinity, a point in focus; middle, corners and diagonals of the square."""
    delicate = [(0.5, 0.5), (0.0, 0.0), (1.0, 1.0), (0.25, 0.25), (0.6, 0.0), (0.2, 1.0), (0.5, 0.8)]
    for leaf in jax.tree.leaves(seen_and_slopes(lens, camera, jnp.array(delicate))):
        assert np.isfinite(leaf).all()


@eqx.filter_jit
def seen_and_slopes(lens: AbstractLens, camera: Camera, samples: jnp.ndarray) -> tuple:
    """All that a lens answers for some samples of the square, and the Jacobians forwards and in reverse."""

    def one(sample):
        return seen(lens, camera, sample), *(
            slopes(lambda lens: seen(lens, camera, sample))(lens) for slopes in (jax.jacfwd, jax.jacrev)
        )

    return jax.vmap(one)(samples)
