"""Files read back as they were written."""

import os
import struct
import zlib

import imageio.v3 as iio
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.film import to_bytes, to_words
from focusjax.io import load_exr, save_exr, save_png


@pytest.fixture
def image():
    return jnp.asarray(np.random.default_rng(3).uniform(0, 1.2, (5, 7, 3)))


def test_png_8(tmp_path, image):
    save_png(tmp_path / "a.png", image, exposure=-1)
    np.testing.assert_array_equal(iio.imread(tmp_path / "a.png"), to_bytes(image, exposure=-1))


def test_png_16(tmp_path, image):
    save_png(tmp_path / "a.png", image, bits=16)
    data = (tmp_path / "a.png").read_bytes()
    width, height, bits, colour = struct.unpack(">IIBB", data[16:26])
    assert (width, height, bits, colour) == (7, 5, 16, 2)
    start = data.index(b"IDAT")
    (length,) = struct.unpack(">I", data[start - 4 : start])
    rows = np.frombuffer(zlib.decompress(data[start + 4 : start + 4 + length]), np.uint8).reshape(
        5, 1 + 7 * 6
    )
    stored = rows[:, 1:].copy().view(">u2").reshape(5, 7, 3)
    np.testing.assert_array_equal(stored, to_words(image))
    # A reader that keeps 8 bits accepts the file, checksums and all.
    assert np.abs(iio.imread(tmp_path / "a.png").astype(int) - to_bytes(image)).max() <= 1


def test_exr_channels(tmp_path, image):
    depth = jnp.full((5, 7), jnp.inf).at[0, 0].set(2.5)
    blur = jnp.linspace(-3, 3, 35).reshape(5, 7)
    save_exr(tmp_path / "a.exr", 5 * image, depth=depth, blur=blur)
    channels = load_exr(tmp_path / "a.exr")
    assert set(channels) == {"R", "G", "B", "Z", "blur"}
    np.testing.assert_array_equal(channels["G"], np.float32(5 * image[..., 1]))
    np.testing.assert_array_equal(channels["Z"], np.float32(depth))
    np.testing.assert_array_equal(channels["blur"], np.float32(blur))


def test_bad_input(tmp_path, image):
    with pytest.raises(ValueError, match="expected 8 or 16"):
        save_png(tmp_path / "a.png", image, bits=12)
    with pytest.raises(ValueError, match="1 values of the picture are not finite; nothing was written"):
        save_exr(tmp_path / "a.exr", image.at[0, 0, 0].set(jnp.nan))
    with pytest.raises(ValueError, match="cannot be read"):
        load_exr(tmp_path / "missing.exr")
    assert not list(tmp_path.iterdir())


def test_an_exr_that_is_cut_off_is_refused_and_nothing_is_printed(tmp_path, capfd):
    """The library prints its remarks itself; what others print before and after stays."""
    path = tmp_path / "cut.exr"
    save_exr(path, np.random.default_rng(0).uniform(size=(40, 60, 3)))
    path.write_bytes(path.read_bytes()[:-3000])
    os.write(2, b"before ")
    with pytest.raises(ValueError, match=r"cut\.exr: is cut off or damaged; copy it again"):
        load_exr(path)
    os.write(2, b"after")
    assert capfd.readouterr() == ("", "before after")
