"""Joining objects to a scene, and what is refused."""

import jax
import numpy as np
import pytest

from focusjax.scene import make_object, make_scene

TRIANGLE = ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
PICTURE = np.ones((2, 2, 3), dtype=np.float32)


def test_objects_keep_their_order_materials_and_textures():
    plain = make_object("plain", *TRIANGLE, colour=(1, 0, 0))
    first = make_object("first", *TRIANGLE, uv=np.zeros((3, 2)), texture=0.5 * PICTURE)
    second = make_object(
        "second", *TRIANGLE, uv=np.zeros((3, 2)), texture=0.25 * PICTURE, translate=(0, 0, 4)
    )
    scene = make_scene([first, plain, second], ambient=(0.1, 0.2, 0.3))
    assert scene.objects == {"first": range(1), "plain": range(1, 2), "second": range(2, 3)}
    assert [scene.materials[m].texture for m in scene.face_material] == [0, -1, 1]
    assert scene.textures[1][0, 0, 0] == 0.25
    np.testing.assert_allclose(scene.vertices[scene.faces[2]][:, 2], 4.0)
    np.testing.assert_allclose(scene.ambient, [0.1, 0.2, 0.3])
    assert scene.faces.dtype == np.int32


def test_an_unknown_name_suggests_the_nearest():
    scene = make_scene([make_object("spot", *TRIANGLE), make_object("vase", *TRIANGLE)])
    assert scene.face_range("vase") == range(1, 2)
    with pytest.raises(ValueError, match=r"no object named 'spott'; did you mean 'spot'\?"):
        scene.face_range("spott")
    with pytest.raises(ValueError, match=r"no object named 'table'; the scene has 'spot', 'vase'"):
        scene.face_range("table")


def test_bad_scenes_are_refused():
    with pytest.raises(ValueError, match="the scene has no objects; expected at least one mesh"):
        make_scene([])
    with pytest.raises(ValueError, match="two objects are named 'a'; give each its own name"):
        make_scene([make_object("a", *TRIANGLE), make_object("a", *TRIANGLE)])
    with pytest.raises(ValueError, match=r"ambient light is -1\.0; expected finite values of at least 0"):
        make_scene([make_object("a", *TRIANGLE)], ambient=-1.0)
    # More than single precision holds.
    with jax.enable_x64(False), pytest.raises(ValueError, match=r"ambient light is 1e\+39; expected finite"):
        make_scene([make_object("a", *TRIANGLE)], ambient=1e39)


@pytest.mark.parametrize(
    ("vertices", "faces", "arguments", "message"),
    [
        (TRIANGLE[0], np.zeros((0, 3)), {}, "object 'a' has no faces"),
        (TRIANGLE[0], [[0, 1, 3]], {}, "refers to vertex 3, but its 3 vertices are 0 to 2"),
        (TRIANGLE[0], [[0, 1, -1]], {}, "refers to vertex -1"),
        ([[0, 0, 0], [np.inf, 0, 0], [0, 1, 0]], [[0, 1, 2]], {}, "NaN or infinite coordinates"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], {}, "expected three coordinates per vertex"),
        (*TRIANGLE, {"uv": np.zeros((2, 2))}, "texture coordinates of shape"),
        (*TRIANGLE, {"uv": np.full((3, 2), np.nan)}, "texture coordinates that are not finite"),
        (*TRIANGLE, {"texture": PICTURE}, "has a texture but no texture coordinates"),
        (*TRIANGLE, {"vertex_colours": np.zeros((3, 4))}, "vertex colours of shape"),
    ],
)
def test_bad_arrays_are_refused(vertices, faces, arguments, message):
    with pytest.raises(ValueError, match=message):
        make_object("a", vertices, faces, **arguments)
