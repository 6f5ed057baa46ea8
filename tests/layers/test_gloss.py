"""What layers hold of glossy surfaces."""

import jax
import numpy as np
from glossy import glossy_camera, glossy_lens, glossy_scene

from focusjax.layers import peel, spread, unpack_normal
from focusjax.layers._shading import pack_normal


def test_packed_normals_keep_their_direction():
    random = np.random.default_rng(0).normal(size=(20000, 3))
    corners = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1)
    corners = corners.reshape(-1, 3)[np.arange(27) != 13]
    normals = np.concatenate([random, corners])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    codes = jax.jit(jax.vmap(pack_normal))(normals)
    assert codes.dtype == np.uint32
    back = np.stack(jax.jit(jax.vmap(unpack_normal))(codes), axis=1)
    np.testing.assert_allclose(np.abs(back).sum(axis=1), 1.0, rtol=1e-12)
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    # Observed: 0.0037 degrees.
    assert np.degrees(np.linalg.norm(back - normals, axis=1)).max() < 0.004


def test_each_sample_knows_its_material_and_the_side_it_is_seen_from():
    scene, camera = glossy_scene(), glossy_camera()
    layers = peel(scene, camera, glossy_lens(), supersampling=1, view_dependent=True)
    gloss = layers.samples.gloss
    assert gloss is not None
    triangle, material = np.asarray(layers.triangle), np.asarray(spread(layers, gloss.material, 0))
    held = np.asarray(layers.disparity) > 0
    centre = triangle >= 0
    assert material.dtype == np.uint8
    np.testing.assert_array_equal(material[centre], scene.face_material[triangle[centre]])
    # The only outline in view is the ball's, and so is the material of its fringe.
    assert (held & ~centre).any()
    assert not material[held & ~centre].any()
    x, y, z = (np.asarray(spread(layers, part, 0.0)) for part in jax.vmap(unpack_normal)(gloss.normal))
    table = held & (material == 1)
    np.testing.assert_allclose(y[table], 1.0, atol=1e-4)
    np.testing.assert_allclose(np.abs(x[table]) + np.abs(z[table]), 0.0, atol=1e-4)
    # The ball shows the half towards the camera, but for shading normals at its outline.
    assert (z[held & (material == 0)] > -0.2).all()
