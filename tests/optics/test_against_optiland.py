"""Rays, first-order data, Seidel sums and indices against Optiland's (scripts/make_lens_references.py)."""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import all_lenses

from focusjax.optics import Prescription, find_glass, first_order, seidel_sums, trace

REFERENCES = json.loads((Path(__file__).parents[1] / "data" / "lens_references.json").read_text())
LENSES = all_lenses()
every_lens = pytest.mark.parametrize("name", REFERENCES["lenses"])


@eqx.filter_jit
def traced(lens: Prescription, wavelength, start, direction):
    indices = lens.indices(wavelength)
    return jax.vmap(lambda p, d: trace(lens, indices, p, d))(start, direction)


def test_every_lens_that_is_shipped_is_compared():
    assert set(LENSES) == set(REFERENCES["lenses"])


@every_lens
def test_rays_are_the_same(name):
    lens = LENSES[name]
    for wavelength, rows in REFERENCES["lenses"][name]["rays"].items():
        # Beyond what a lens lets through, one ray of all meets nothing there, either.
        assert len(rows) >= 23
        start, direction, end = (
            np.array([row[key] for row in rows]) for key in ("start", "direction", "end")
        )
        rays = traced(lens, jnp.asarray(float(wavelength)), jnp.asarray(start), jnp.asarray(direction))
        film = float(lens.vertices()[-1] + (lens.thicknesses[-1] or 50.0))
        position, way = np.asarray(rays.position), np.asarray(rays.direction)
        landed = position + way * ((film - position[:, 2:]) / way[:, 2:])
        # Observed: 1.4e-13 mm, and 3e-15 in directions.
        np.testing.assert_allclose(landed[:, :2], end[:, :2], rtol=0, atol=1e-12)
        np.testing.assert_allclose(way, end[:, 3:], rtol=0, atol=1e-13)


@every_lens
def test_first_order_data_are_the_same(name):
    lens, wanted = LENSES[name], REFERENCES["lenses"][name]["first_order"]
    seen = first_order(lens)
    film = float(lens.thicknesses[-1] or 50.0)
    found = {
        "focal_length": float(seen.focal_length),
        "front_focal_distance": float(seen.front_focal_distance),
        "image_focal_point": float(seen.back_focal_distance) - film,
        "entrance_pupil": float(seen.entrance_pupil),
        "exit_pupil": float(seen.exit_pupil) - film,
        "exit_pupil_diameter": 2 * float(seen.exit_pupil_radius),
        "f_number": float(seen.f_number),
    }
    # Observed: 5e-14 of the focal length.
    for key, value in wanted.items():
        assert found[key] == pytest.approx(value, rel=1e-11, abs=1e-11), key


# Optiland's sums leave the polynomial of an asphere out; test_seidel.py takes them from traced rays.
@pytest.mark.parametrize("name", [name for name in REFERENCES["lenses"] if name != "asphere"])
def test_seidel_sums_are_the_same(name):
    field = np.radians(REFERENCES["field_deg"])
    sums = seidel_sums(LENSES[name], field=field)
    found = [
        -float(part.sum())
        for part in (sums.spherical, sums.coma, sums.astigmatism, sums.petzval, sums.distortion)
    ]
    # Observed: 4e-14.
    np.testing.assert_allclose(found, REFERENCES["lenses"][name]["seidel"], rtol=1e-11)


def test_indices_are_the_same():
    assert len(REFERENCES["indices"]) == 1580
    wavelengths = jnp.asarray(REFERENCES["wavelengths_nm"])
    indices = eqx.filter_jit(lambda glass: jax.vmap(glass.index)(wavelengths))
    for name, wanted in REFERENCES["indices"].items():
        found = indices(find_glass(name))
        # Observed: 3e-16, of 1,580.
        np.testing.assert_allclose(found, wanted, rtol=1e-12, err_msg=name)
