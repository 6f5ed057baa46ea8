"""Picture metrics: closed forms, limits, refusals."""

import numpy as np
import pytest

from focusjax.metrics import psnr, ssim


def noise(seed: int, shape=(24, 20, 3)) -> np.ndarray:
    return np.random.default_rng(seed).uniform(size=shape)


def test_psnr_of_a_constant_offset() -> None:
    picture = noise(0)
    assert psnr(picture + 0.01, picture) == pytest.approx(40.0, abs=1e-9)
    assert psnr(picture + 0.01, picture, data_range=10.0) == pytest.approx(60.0, abs=1e-9)


def test_psnr_of_equal_pictures_is_infinite() -> None:
    assert psnr(noise(0), noise(0)) == float("inf")


def test_psnr_looks_only_where_the_mask_says() -> None:
    picture, other = noise(0), noise(0)
    other[:5] += 0.1
    mask = np.zeros(picture.shape[:2], dtype=bool)
    mask[:5] = True
    assert psnr(other, picture, mask=mask) == pytest.approx(20.0, abs=1e-9)
    assert psnr(other, picture, mask=~mask) == float("inf")


def test_ssim_is_one_for_equal_pictures_and_falls_with_noise() -> None:
    picture = noise(0)
    slight, strong = (ssim(picture + size * (noise(1) - 0.5), picture) for size in (0.05, 0.5))
    assert ssim(picture, picture) == pytest.approx(1.0, abs=1e-12)
    assert 1.0 > slight > strong > 0.0


def test_ssim_of_two_flat_pictures_is_its_luminance_term() -> None:
    low, high = np.full((16, 16, 3), 0.2), np.full((16, 16, 3), 0.6)
    c1 = 0.01**2
    expected = (2 * 0.2 * 0.6 + c1) / (0.2**2 + 0.6**2 + c1)
    assert ssim(low, high) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (noise(0, (9, 20, 3)), {}, "have shapes .* expected the same"),
        (np.full((24, 20, 3), np.nan), {}, "the image has 1440 values that are not finite"),
        (noise(0), {"data_range": 0.0}, "the data range is 0.0; expected a positive"),
        (noise(0), {"mask": np.ones((2, 2), dtype=bool)}, r"the mask has shape \(2, 2\)"),
        (noise(0), {"mask": np.zeros((24, 20), dtype=bool)}, "the mask selects no pixel"),
    ],
)
def test_psnr_refuses(image: np.ndarray, options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        psnr(image, noise(0), **options)


def test_refuses_what_is_not_a_colour_picture() -> None:
    with pytest.raises(ValueError, match="expected height x width x 3"):
        psnr(np.zeros((4, 4)), np.zeros((4, 4)))
    with pytest.raises(ValueError, match="needs 11 pixels"):
        ssim(np.zeros((4, 40, 3)), np.zeros((4, 40, 3)))
