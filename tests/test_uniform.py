"""Energy: where everything has the same radiance, so has every pixel, whatever the lens."""

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from focusjax.geometry import look_at
from focusjax.layers import peel
from focusjax.lens import (
    AberratedLens,
    AbstractAperture,
    Disk,
    ThinLens,
    chromatic_lens,
    mask,
    polygon,
    power_profile,
    seidel,
)
from focusjax.scene import Scene, constant_background, make_object, make_scene
from focusjax.trace import render

RADIANCE = np.array([0.25, 1.0, 7.0])


def room(walls: bool) -> Scene:
    """Balls and a bar close to the lens in a closed room, or under a sky; all of one radiance."""
    meshes = {
        "ball": (trimesh.creation.icosphere(subdivisions=2, radius=0.4), (0.5, 0.1, -2.5)),
        "on border": (trimesh.creation.icosphere(subdivisions=2, radius=0.3), (-0.75, 0.2, -2.0)),
        "bar": (trimesh.creation.box(extents=(0.03, 3.0, 0.03)), (0.1, 0.0, -0.8)),
        "slope": (trimesh.creation.box(extents=(6.0, 0.02, 9.0)), (0.0, -0.5, -2.0)),
    }
    if walls:
        meshes["walls"] = (trimesh.creation.box(extents=(8.0, 6.0, 14.0)), (0.0, 0.0, 0.0))
    objects = [
        make_object(name, mesh.vertices, mesh.faces, colour=(0, 0, 0), emission=RADIANCE, translate=place)
        for name, (mesh, place) in meshes.items()
    ]
    return make_scene(objects, background=constant_background(0.0 if walls else RADIANCE), unlit=True)


@pytest.mark.parametrize(
    ("walls", "focus", "radius", "aperture"),
    [
        pytest.param(True, 0.8, 0.06, Disk(), id="room, near focus"),
        pytest.param(True, np.inf, 0.06, polygon(5, rotation=0.2), id="room, focus on infinity"),
        pytest.param(True, 7.0, 0.0, Disk(), id="room, pinhole"),
        pytest.param(False, 0.8, 0.06, Disk(), id="sky, near focus"),
        pytest.param(False, np.inf, 0.06, polygon(3), id="sky, focus on infinity"),
    ],
)
def test_stays_uniform(walls: bool, focus: float, radius: float, aperture: AbstractAperture) -> None:
    camera = look_at(np.zeros(3), np.array([0.1, -0.1, -1.0]), width=48, height=40, field_of_view=0.8)
    lens = ThinLens(jnp.array(1.0 / focus), jnp.array(radius), aperture)
    picture = np.asarray(render(peel(room(walls), camera, lens, supersampling=2), lens, rays=16))
    # Observed: no difference at all, in double precision.
    np.testing.assert_allclose(picture, np.broadcast_to(RADIANCE, picture.shape), rtol=1e-5)


@pytest.mark.slow
def test_stays_uniform_through_a_lens_of_many_faults() -> None:
    """An opening that is brighter here than there, aberrations, and colours that go their own ways."""
    camera = look_at(np.zeros(3), np.array([0.1, -0.1, -1.0]), width=48, height=40, field_of_view=0.8)
    thin = ThinLens(jnp.array(1.0), jnp.array(0.06), mask(np.array([[0.2, 1.0], [0.7, 0.0]])))
    faults = seidel(thin, camera, w040=0.5, w131=1.0, w222=-1.0, w311=2.0), power_profile([0.0, 0.1])
    lens = chromatic_lens(AberratedLens(thin, faults), focus_offset=(-0.1, 0.0, 0.1), bands=5)
    picture = np.asarray(render(peel(room(walls=False), camera, lens, supersampling=2), lens, rays=16))
    # Observed: 4e-16 relative, the sum of the bands' shares.
    np.testing.assert_allclose(picture, np.broadcast_to(RADIANCE, picture.shape), rtol=1e-5)
