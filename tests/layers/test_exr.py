"""Layers through OpenEXR come back bit for bit, and other programs see colours, coverage and distance."""

import equinox as eqx
import jax
import numpy as np
import OpenEXR
import pytest
from glossy import glossy_camera, glossy_lens, glossy_scene

import focusjax as fj


def pane_layers(**settings):
    """A pane that is half there, 1 m before a wall, seen by a small camera through a bladed lens."""
    corners = np.array([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    faces = [(0, 1, 2), (0, 2, 3)]
    pane = fj.make_object("pane", 0.2 * corners + (0, 0, -1), faces, opacity=0.5, colour=(1, 0, 0))
    wall = fj.make_object("wall", 4 * corners + (0, 0, -2), faces, colour=(0, 1, 1))
    scene = fj.make_scene([pane, wall], unlit=True)
    camera = fj.look_at((0, 0, 0), (0, 0, -1), width=24, height=18, focal_length=0.05)
    lens = fj.tilt_shift_lens(focus_distance=1.5, f_number=2, focal_length=0.05, tilt=0.02, swing=0.0,
                              aperture=fj.polygon(5))  # fmt: skip
    return fj.peel(scene, camera, lens, supersampling=1, **settings), lens


def same_bits(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        if eqx.is_array(a):
            assert isinstance(b, jax.Array)
            assert a.dtype == b.dtype
            assert a.shape == b.shape
            assert np.asarray(a).tobytes() == np.asarray(b).tobytes()
        else:
            assert a == b


def test_all_leaves_and_the_picture_are_bit_equal(tmp_path):
    layers, lens = pane_layers()
    fj.save_layers(tmp_path / "pane.exr", layers)
    back = fj.load_layers(tmp_path / "pane.exr")
    same_bits(layers, back)
    picture = np.asarray(fj.render(layers, lens, rays=8, seed=3))
    assert np.asarray(fj.render(back, lens, rays=8, seed=3)).tobytes() == picture.tobytes()


def test_gloss_with_its_lights_is_bit_equal(tmp_path):
    layers = fj.peel(glossy_scene(), glossy_camera(), glossy_lens(), supersampling=1, view_dependent=True)
    assert layers.samples.gloss is not None
    fj.save_layers(tmp_path / "gloss.exr", layers)
    same_bits(layers, fj.load_layers(tmp_path / "gloss.exr"))


def test_other_programs_see_premultiplied_colours_and_metres(tmp_path):
    fj.save_layers(tmp_path / "pane.exr", pane_layers()[0])
    with OpenEXR.File(str(tmp_path / "pane.exr"), separate_channels=True) as file:
        names = [part.name() for part in file.parts]
        near, far = ({k: c.pixels for k, c in part.channels.items()} for part in file.parts[:2])
    assert names == ["layer1", "layer2", "focusjax"]
    assert set(near) == set("RGBAZ")
    middle = (9, 12)
    # Opacities are kept in steps of 1/255.
    assert near["A"][middle] == pytest.approx(0.5, abs=0.003)
    np.testing.assert_allclose([near[c][middle] for c in "RGB"], [near["A"][middle], 0, 0], atol=1e-6)
    np.testing.assert_allclose([far[c][middle] for c in "RGBA"], [0, 1, 1, 1], atol=1e-6)
    # Observed 2e-5: half a step of the packed disparities.
    assert near["Z"][middle] == pytest.approx(1.0, rel=1e-4)
    assert far["Z"][middle] == pytest.approx(2.0, rel=1e-4)
    # Beside the pane the wall is the nearest.
    assert near["Z"][0, 0] == pytest.approx(2.0, rel=1e-4)
    assert far["Z"][0, 0] == np.inf
    assert far["A"][0, 0] == 0


def test_what_cannot_be_read_is_said(tmp_path, capfd):
    path = tmp_path / "pane.exr"
    fj.save_layers(path, pane_layers()[0])
    with pytest.raises(ValueError, match=r"pane\.ex: layers are written to OpenEXR files; give a name"):
        fj.save_layers(tmp_path / "pane.ex", pane_layers()[0])
    with pytest.raises(ValueError, match=r"nowhere.*choose another place"):
        fj.save_layers(tmp_path / "nowhere" / "pane.exr", pane_layers()[0])
    with pytest.raises(ValueError, match="there is no such file of layers"):
        fj.load_layers(tmp_path / "none.exr")
    (tmp_path / "cut.exr").write_bytes(path.read_bytes()[:-3000])
    with pytest.raises(ValueError, match=r"cut\.exr: is cut off or damaged; copy it again"):
        fj.load_layers(tmp_path / "cut.exr")
    # Here the pictures are whole, and what is cut off is the last part.
    (tmp_path / "cut.exr").write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ValueError, match=r"cut\.exr: is cut off or damaged; copy it again"):
        fj.load_layers(tmp_path / "cut.exr")
    assert capfd.readouterr() == ("", "")
    fj.save_exr(tmp_path / "picture.exr", np.ones((2, 3, 3)))
    with pytest.raises(ValueError, match=r"picture\.exr: has no part 'focusjax' with layers; .*load_photo"):
        fj.load_layers(tmp_path / "picture.exr")
    with OpenEXR.File(str(path), separate_channels=True) as file:
        words = file.parts[-1].channels["bits"].pixels
        words[0, 3] ^= 1
        file.write(str(tmp_path / "changed.exr"))
    with pytest.raises(ValueError, match=r"changed\.exr: its layers cannot be read back \(it was changed"):
        fj.load_layers(tmp_path / "changed.exr")
