"""Pictures as linear light: decoding of sRGB, and image files of 8, 16 or 32 bits per channel."""

import io
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from focusjax.scene._exr import colour_channels, exr_channels
from focusjax.scene._sizes import MOST_PIXELS, check_pixels


def open_picture(source: str | Path | io.BytesIO) -> Image.Image:
    """A picture that is not decoded yet.

    Raises:
        ValueError: it has too many pixels.
        OSError: no picture.
    """
    with warnings.catch_warnings():
        # Pillow warns of large pictures; the limit here says what is too large.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            picture = Image.open(source)
        except Image.DecompressionBombError:
            raise ValueError(
                f"it has more pixels than can be read; expected at most {MOST_PIXELS / 1e6:.0f} million,"
                " so make it smaller"
            ) from None
    try:
        check_pixels(picture.size)
    except ValueError:
        picture.close()
        raise
    return picture


def decode_srgb(values: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Linear values of sRGB-encoded ones in 0 to 1 (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4)


def unit_range(values: np.ndarray) -> Float[np.ndarray, "*shape"]:
    """Stored samples as floats, with the largest value of an integer type at 1."""
    if np.issubdtype(values.dtype, np.integer):
        return values.astype(np.float64) / np.iinfo(values.dtype).max
    return values.astype(np.float64)


def texture_of(image: Image.Image) -> Float[np.ndarray, "h w 3"]:
    """Linear float32 RGB of an sRGB picture; `opacity_of` has its opacity."""
    # Palettes and CMYK have no RGB samples to read; 16-bit greys would be cut to 8 by a conversion.
    plain = image if image.mode in ("L", "RGB", "I;16", "I;16B") else image.convert("RGB")
    samples = decode_srgb(unit_range(np.asarray(plain))).astype(np.float32)
    return np.repeat(samples[..., None], 3, axis=2) if samples.ndim == 2 else samples


def opacity_of(image: Image.Image) -> Float[np.ndarray, "h w"] | None:
    """The alpha channel, 0 to 1, in float32; None where the picture has none or is opaque all over."""
    if not image.has_transparency_data:
        return None
    alpha = unit_range(np.asarray(image.convert("RGBA").getchannel("A"))).astype(np.float32)
    return None if (alpha == 1.0).all() else alpha


def brightness_of(image: Image.Image) -> Float[np.ndarray, "h w"]:
    """The grey of a picture as it is stored, 0 to 1, in float32: what opacity maps hold."""
    plain = image if image.mode in ("L", "I;16", "I;16B") else image.convert("L")
    return unit_range(np.asarray(plain)).astype(np.float32)


def fill_hidden(
    picture: Float[np.ndarray, "h w 3"], opacity: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w 3"]:
    """`picture` with the colour of the nearest texel that shows wherever `opacity` is 0.

    Colours there mean nothing, but filtering would mix them into the outlines.
    """
    if picture.shape[:2] != opacity.shape or not (opacity == 0).any() or not (opacity > 0).any():
        return picture
    from scipy.ndimage import distance_transform_edt

    nearest = np.zeros((2, *opacity.shape), dtype=np.int32)
    distance_transform_edt(opacity == 0, return_distances=False, return_indices=True, indices=nearest)
    return picture[*nearest]


def read_image(path: str | Path) -> Float[np.ndarray, "h w 3"]:
    """Linear float32 RGB [h, w, 3] of an image file.

    OpenEXR files hold linear light already, in R, G and B or in a layer of any name; every other format is
    decoded from sRGB.

    Raises:
        ValueError: the file does not exist, is not a picture, or has too many pixels.
    """
    path = Path(path)
    if not path.is_file():
        wrong = "is a folder; name a file in it" if path.is_dir() else "does not exist; check the path"
        raise ValueError(f"image file {path} {wrong}")
    try:
        if path.suffix.lower() == ".exr":
            channels = exr_channels(path)
            names = colour_channels(channels)
            if names is None:
                raise ValueError(f"there are no R, G and B among its channels {', '.join(channels)}")
            return np.stack([channels[name] for name in names], axis=-1).astype(np.float32)
        with open_picture(path) as picture:
            return texture_of(picture)
    except Exception as error:
        raise ValueError(f"image file {path} cannot be read: {error}") from error
