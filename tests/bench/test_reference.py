"""Converged pictures: made once, kept apart, never half there."""

import numpy as np
import pytest

from focusjax.bench import ChoiceError, reference_picture
from focusjax.bench import _reference as module
from focusjax.bench._makers import maker_named
from focusjax.metrics import psnr


@pytest.fixture
def calls(monkeypatch):
    """Makes pictures in this process and notes what was asked for."""
    noted = []

    def made(maker, case, parts):
        noted.extend(parts)
        return [maker_named(maker)(case, *part) for part in parts]

    monkeypatch.setattr(module, "made_apart", made)
    return noted


def test_made_once(case, tmp_path, calls):
    first = reference_picture(case, maker="raycast", samples=9, cache=tmp_path / "new")
    assert [samples for samples, _ in calls] == [4, 5]
    assert calls[0][1] != calls[1][1]
    again = reference_picture(case, maker="raycast", samples=9, cache=tmp_path / "new")
    assert len(calls) == 2
    assert (first.kept, again.kept) == (False, True)
    np.testing.assert_allclose(again.picture, first.picture, atol=1e-6)
    assert again.floor_psnr == first.floor_psnr
    reference_picture(case, maker="raycast", samples=10, cache=tmp_path / "new")
    assert len(calls) == 4
    assert len(list((tmp_path / "new").iterdir())) == 2


def test_its_own_error_is_estimated(case, tmp_path, calls):
    rough = reference_picture(case, maker="raycast", samples=8, cache=tmp_path)
    fine = reference_picture(case, maker="raycast", samples=256, cache=tmp_path)
    # Observed: 29.5 dB estimated, 29.7 dB found.
    assert rough.floor_psnr == pytest.approx(psnr(rough.picture, fine.picture), abs=1.5)
    assert fine.floor_psnr > rough.floor_psnr + 10


def test_samples_that_are_not_finite_are_left_out_and_counted(case, tmp_path, monkeypatch):
    """A pixel that one half lacks is the other's; one that both lack is the mean of its neighbours."""
    first, second = np.full((24, 32, 3), 0.2), np.full((24, 32, 3), 0.4)
    first[3, 4], second[3, 5, 1], first[8, 8], second[8, 8] = np.nan, np.inf, np.nan, -np.inf
    monkeypatch.setattr(module, "made_apart", lambda *_: [(first, 2), (second, 5)])
    found = reference_picture(case, maker="raycast", samples=4, cache=tmp_path)
    expected = np.full((24, 32, 3), 0.3)
    expected[3, 4], expected[3, 5] = 0.4, 0.2
    np.testing.assert_allclose(found.picture, expected)
    assert found.dropped == 7
    assert np.isfinite(found.floor_psnr)
    assert reference_picture(case, maker="raycast", samples=4, cache=tmp_path).dropped == 7


def test_a_broken_file_is_made_anew(case, tmp_path, calls):
    reference_picture(case, maker="raycast", samples=4, cache=tmp_path)
    next(tmp_path.iterdir()).write_bytes(b"half a fi")
    assert not reference_picture(case, maker="raycast", samples=4, cache=tmp_path).kept
    assert reference_picture(case, maker="raycast", samples=4, cache=tmp_path).kept


def test_nothing_is_left_of_one_that_fails(case, tmp_path, monkeypatch):
    def interrupted(*arguments, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr(module.np, "savez_compressed", interrupted)
    monkeypatch.setattr(
        module, "made_apart", lambda *_: [(np.zeros((24, 32, 3)), 0), (np.ones((24, 32, 3)), 0)]
    )
    with pytest.raises(KeyboardInterrupt):
        reference_picture(case, maker="raycast", samples=4, cache=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("maker", "samples", "sentence"),
    [
        ("raycast", 1, "to have 1 samples per pixel; expected at least 2"),
        ("painter", 16, "by 'painter'; expected mitsuba or raycast"),
    ],
)
def test_bad_references(case, tmp_path, maker, samples, sentence):
    with pytest.raises(ChoiceError, match=sentence):
        reference_picture(case, maker=maker, samples=samples, cache=tmp_path)


def test_a_cache_that_cannot_be_made(case, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ValueError, match=r"folder .*file for references cannot be made .* with --cache"):
        reference_picture(case, maker="raycast", samples=4, cache=tmp_path / "file")
