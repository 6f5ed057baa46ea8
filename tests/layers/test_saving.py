"""What the umbra saves is what peeling in both ways keeps."""

import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_layers, varied_scene, wide_lens

from focusjax.layers import Layers, peel, umbra_saving
from focusjax.scene import make_scene


def samples_by_layer(layers: Layers) -> tuple[int, ...]:
    """Samples that show a surface at their centre, in each layer that has any."""
    counts = (np.asarray(layers.triangle) >= 0).sum(axis=(1, 2))
    return tuple(int(count) for count in counts if count)


def test_counts_are_those_of_the_layers():
    scene, camera, lens = varied_scene(), front_camera(), varied_layers().lens
    saving = umbra_saving(scene, camera, lens, supersampling=2)
    plain = peel(scene, camera, lens, supersampling=2, max_layers=12, umbra=False)
    assert plain.complete
    assert saving.umbra == samples_by_layer(varied_layers())
    assert saving.plain == samples_by_layer(plain)
    assert saving.samples_saved == pytest.approx(1 - varied_layers().samples_kept / plain.samples_kept)
    assert saving.layers_saved == 0


def test_layers_hidden_by_a_solid_front_are_saved():
    camera = front_camera()
    walls = [patch(str(w), camera, (-60, -60, 90, 90), w) for w in (0.6, 0.5, 0.4)]
    twice = patch("twice", camera, (-60, -60, 90, 90), 0.4)
    saving = umbra_saving(
        make_scene([*walls, twice], unlit=True), camera, wide_lens(camera, pixels_per_dioptre=2.0)
    )
    assert len(saving.plain) == 3
    assert saving.plain[0] == saving.plain[1] == saving.plain[2] == saving.umbra[0]
    assert saving.samples_saved > 0.5


def test_nothing_in_view_saves_nothing():
    camera = front_camera()
    behind = patch("behind", camera, (0, 0, 9, 9), -0.5)
    saving = umbra_saving(make_scene([behind]), camera, wide_lens(camera))
    assert saving.plain == saving.umbra == ()
    assert saving.samples_saved == 0.0


def test_a_supersampling_below_one_is_refused():
    camera = front_camera()
    with pytest.raises(ValueError, match="supersampling is 0; expected a whole number, at least 1"):
        umbra_saving(varied_scene(), camera, wide_lens(camera), supersampling=0)
