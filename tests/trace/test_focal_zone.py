"""Where a lens is sharp, by closed forms, and that nothing finer than it says is in the blur."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import HEIGHT, WIDTH, front_camera, wide_lens

from focusjax.lens import AberratedLens, ThinLens, obstructed, polygon, seidel, squeezed, tilt_shift_lens
from focusjax.trace._coc_bins import focal_zone

CENTRES = np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), axis=-1).reshape(-1, 2)


def thin() -> ThinLens:
    return wide_lens(front_camera())


def test_a_thin_lens_is_sharp_at_its_focus_alone():
    zone = focal_zone(thin(), front_camera())
    for found in (zone.near, zone.far):
        # Observed: 4e-9, the root of what rounding leaves of a double root's discriminant.
        np.testing.assert_allclose(found, thin().focus_disparity, atol=1e-7)
    np.testing.assert_allclose(zone.parallax, thin().parallax(front_camera()), rtol=1e-9)


def test_reach_is_where_blur_has_a_radius():
    near, far = focal_zone(thin(), front_camera()).reach(3.0)
    film = jnp.array([WIDTH / 2, HEIGHT / 2])
    for disparity, sign in ((near[0], -1), (far[0], 1)):
        # Blur is a diameter, positive behind the focus.
        assert float(thin().blur(front_camera(), film, disparity)) == pytest.approx(sign * 6.0, abs=1e-6)


def test_a_tilted_lens_is_sharp_along_its_plane():
    camera = front_camera()
    lens = tilt_shift_lens(focus_distance=2.0, focal_length=0.05, tilt=0.05, f_number=1.4)
    zone = focal_zone(lens, camera)
    blur = jax.vmap(lambda film, disparity: lens.blur(camera, film, disparity))
    sharp = jnp.stack([zone.near, zone.far])
    assert float(jnp.ptp(zone.near)) > 0.1
    for disparity in sharp:
        # Of the width of the disks a dioptre away, 20 px and more.
        np.testing.assert_allclose(blur(jnp.asarray(CENTRES), disparity), 0.0, atol=0.05)


@pytest.mark.parametrize(
    ("opening", "share"),
    [
        (polygon(6), np.cos(np.pi / 6)),
        (polygon(6, roundness=1.0), 1.0),
        (obstructed(0.4), 0.3),
        (squeezed(2.0, polygon(4)), np.sqrt(0.5) / 2),
    ],
)
def test_fine_openings_make_fine_pictures(opening, share: float):
    lens = ThinLens(thin().focus_disparity, thin().aperture_radius, opening)
    zone = focal_zone(lens, front_camera())
    np.testing.assert_allclose(zone.parallax, share * float(thin().parallax(front_camera())), rtol=1e-6)


def test_aberrations_widen_the_zone():
    """Beyond it no two rays of the opening cross; spherical aberration focuses each ring elsewhere."""
    camera = front_camera()
    lens = AberratedLens(thin(), (seidel(thin(), camera, w040=1.0),))
    zone, ideal = focal_zone(lens, camera), focal_zone(thin(), camera)
    width = np.asarray(zone.near - zone.far)
    assert (width > 10 * np.asarray(ideal.near - ideal.far)).all()
    film = jnp.array([WIDTH / 2, HEIGHT / 2])

    def det(point, disparity):
        def at(point):
            ray = lens.ray(camera, film, point)
            return ray.a + ray.b * disparity

        return jnp.linalg.det(jax.jacfwd(at)(point))

    middle = HEIGHT // 2 * WIDTH + WIDTH // 2
    for disparity in (zone.near[middle] + 0.02, zone.far[middle] - 0.02):
        radii = np.linspace(0, 0.97, 40)
        signs = {float(jnp.sign(det(jnp.array([radius, 0.1]), disparity))) for radius in radii}
        assert len(signs) == 1


def test_a_closed_lens_has_no_blur():
    zone = focal_zone(ThinLens(jnp.array(0.5), jnp.array(0.0)), front_camera())
    assert not np.asarray(zone.parallax).any()
    assert np.isfinite(np.asarray(zone.near)).all()
