"""What notebooks show."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

import focusjax as fj
from focusjax.focus import ArgumentError


def test_a_picture_is_shown_small_and_as_it_is_saved():
    picture = np.zeros((30, 640, 3))
    picture[:, 320:] = 1.0
    page = fj.show(picture)._repr_html_()
    data = base64.b64decode(re.search(r"base64,([^\"]+)", page)[1])
    shown = np.asarray(Image.open(io.BytesIO(data)))
    assert shown.shape == (15, 320, 3)
    assert shown[7, 40].tolist() == [0, 0, 0]
    assert shown[7, 280].tolist() == [255, 255, 255]


def test_scenes_and_lenses_are_described_in_a_few_words():
    card = fj.make_object("a <card>", [(0, 0, -2), (1, 0, -2), (0, 0.5, -2)], [(0, 1, 2)])
    scene = fj.make_scene([card], unlit=True)
    shown = fj.show(scene)
    assert repr(shown) == repr(scene) == "Scene(1 triangles of a <card>; 0 lights)"
    assert "<td>a &lt;card&gt;</td><td>1</td><td>1.00 m x 50 cm x 0 cm</td>" in shown._repr_html_()
    lens = fj.tilt_shift_lens(tilt=0.1, focus_distance=2.0, f_number=2.0, focal_length=0.05)
    assert re.fullmatch(r"TiltShiftLens: focus [\d.]+ m, opening 25 mm across", repr(fj.show(lens)))


def test_layers_have_a_short_text_and_a_sharp_picture():
    card = fj.make_object("card", [(-1, -1, -2), (1, -1, -2), (0, 1, -2)], [(0, 1, 2)])
    camera = fj.make_camera(np.eye(4), width=16, height=12, focal_length=0.05)
    lens = fj.thin_lens(focus_distance=2.0, f_number=2.0, focal_length=0.05)
    layers = fj.peel(fj.make_scene([card], unlit=True), camera, lens)
    assert repr(layers).endswith("of 16 x 12 pixels, peeled for a ThinLens)")
    assert 'width="16" height="12"' in fj.show(layers)._repr_html_()


def test_what_cannot_be_shown_is_refused():
    with pytest.raises(ArgumentError, match="thing is a dict; expected a scene, a lens"):
        fj.show({})
