"""What is refused of objects that a program makes."""

import numpy as np
import pytest

from focusjax.scene import make_object

CORNERS = [(0.0, 0.0, -2.0), (1.0, 0.0, -2.0), (0.0, 1.0, -2.0)]
FACES = [(0, 1, 2)]


def texture(value: float) -> np.ndarray:
    picture = np.ones((2, 3, 3))
    picture[1, 2, 0] = value
    return picture


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.1])
def test_textures_are_light(value):
    with pytest.raises(ValueError, match=r"1 texels that are negative or not finite \(the first in row 1"):
        make_object("a", CORNERS, FACES, uv=np.zeros((3, 2)), texture=texture(value))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"faces": []}, "object 'a' has no faces; expected a mesh of triangles"),
        ({"faces": [(0, 1, 1)]}, r"object 'a' has no area: its triangles \(1\) are lines or points"),
        ({"scale": 1e-30}, r"object 'a' is \S+e-30 m from end to end; expected at least 1e-12 m, so give a"),
        ({"scale": 1e-30, "translate": (0, 0, -2)}, "expected at least 1e-12 m, so give a larger scale"),
        ({"scale": 1e15}, r"object 'a' reaches 2e\+15 m from the origin; expected at most 1e\+12 m"),
        ({"translate": (0, 0, -1e13)}, r"reaches 1e\+13 m from the origin"),
        ({"vertex_colours": np.full((3, 3), -1.0)}, r"vertex colours below 0 \(the least is -1\)"),
        ({"cutoff": 0.5}, r"a cutoff of 0\.5, but nothing to cut"),
        ({"uv": np.zeros((3, 2)), "texture": texture(1.0), "cutoff": 0.5}, "nothing to cut"),
    ],
)
def test_what_cannot_be_seen_is_refused(arguments, message):
    given = {"vertices": CORNERS, "faces": FACES} | arguments
    with pytest.raises(ValueError, match=message):
        make_object("a", given.pop("vertices"), given.pop("faces"), **given)
