"""The blur map shows signs by colour and wishes where they are."""

import imageio.v3 as iio
import numpy as np

from focusjax.report._blur_picture import save_blur_picture


def test_white_in_focus_red_behind_blue_in_front(tmp_path):
    blur = np.repeat(np.array([[-20.0, 0.0, 20.0]]), 20, axis=1).repeat(30, axis=0)
    save_blur_picture(tmp_path / "blur.png", blur, [])
    pixels = iio.imread(tmp_path / "blur.png")[..., :3].astype(int)
    row = pixels[pixels.shape[0] // 3]
    front, focus, behind = (row[int(share * len(row))] for share in (1 / 6, 1 / 2, 5 / 6))
    assert front[2] > front[0] + 50
    assert focus.min() > 240
    assert behind[0] > behind[2] + 50


def test_a_wish_is_drawn_where_it_is(tmp_path):
    blur = np.zeros((60, 80))
    marks = [("here", np.array([[20.0, 15.0]])), ("several", np.array([[60.0, 40.0], [62.0, 44.0]]))]
    save_blur_picture(tmp_path / "plain.png", blur, [])
    save_blur_picture(tmp_path / "marked.png", blur, marks)
    plain, marked = (iio.imread(tmp_path / name)[..., :3].astype(int) for name in ("plain.png", "marked.png"))
    changed = np.abs(marked - plain).max(axis=-1) > 60
    rows, columns = np.nonzero(changed[:, : changed.shape[1] // 2])
    scale = plain.shape[1] / 80
    # The ring is the leftmost thing drawn; its name goes to the right of it.
    assert abs(columns.min() / scale - 20.0) < 2.0
    assert abs(np.median(rows) / scale - 15.0) < 4.0
