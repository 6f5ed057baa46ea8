"""Picture files: PNG for looking at, OpenEXR for everything that must stay linear."""

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import imageio.v3 as iio
import jax.numpy as jnp
import numpy as np
import OpenEXR
from jaxtyping import Array, Float, UInt16

from focusjax._quiet_exr import open_exr
from focusjax.film import to_bytes, to_words

Pixels = Array | np.ndarray
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def save_png(
    path: Path | str, image: Float[Pixels, "h w 3"], *, exposure: float = 0.0, bits: int = 8
) -> None:
    """Write linear `image` [h, w, 3] as an sRGB picture.

    Args:
        path: file to write.
        image: linear radiance.
        exposure: stops added before encoding.
        bits: 8 or 16 per channel.

    Raises:
        ValueError: other bits, or values that are not finite.

    Example:
        >>> import imageio.v3 as iio
        >>> fj.save_png("grey.png", np.full((6, 8, 3), 0.25), exposure=2.0)
        >>> pixels = iio.imread("grey.png")
        >>> pixels.shape, int(pixels[0, 0, 0])
        ((6, 8, 3), 255)
    """
    if bits not in (8, 16):
        raise ValueError(f"a PNG with {bits} bits per channel was asked for; expected 8 or 16")
    _refuse_non_finite(path, image)
    image = jnp.asarray(image)
    if bits == 8:
        iio.imwrite(path, to_bytes(image, exposure=exposure), extension=".png")
    else:
        Path(path).write_bytes(png16(to_words(image, exposure=exposure)))


def save_exr(
    path: Path | str,
    image: Float[Pixels, "h w 3"],
    *,
    depth: Float[Pixels, "h w"] | None = None,
    blur: Float[Pixels, "h w"] | None = None,
) -> None:
    """Write linear `image` as 32-bit float OpenEXR with channels R, G, B and what else is given.

    Args:
        path: file to write.
        image: linear radiance [h, w, 3].
        depth: distance along the view axis in metres [h, w], channel Z; infinite on the background.
        blur: signed circle-of-confusion diameter in pixels [h, w], channel `blur`.

    Raises:
        ValueError: the picture holds values that are not finite.

    Example:
        >>> fj.save_exr("picture.exr", np.zeros((6, 8, 3)), depth=np.full((6, 8), 2.0))
        >>> channels = fj.load_exr("picture.exr")
        >>> sorted(channels), float(channels["Z"][0, 0])
        (['B', 'G', 'R', 'Z'], 2.0)
    """
    pixels = np.asarray(image, dtype=np.float32)
    _refuse_non_finite(path, pixels)
    channels = {name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGB")}
    for name, plane in (("Z", depth), ("blur", blur)):
        if plane is not None:
            channels[name] = np.ascontiguousarray(plane, dtype=np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def load_exr(path: Path | str) -> Mapping[str, Float[np.ndarray, "h w"]]:
    """All channels of an OpenEXR file by name, as float32 [h, w].

    Raises:
        ValueError: the file cannot be read, or is cut off.

    Example:
        >>> fj.save_exr("picture.exr", np.full((6, 8, 3), 0.5))
        >>> {name: plane.shape for name, plane in sorted(fj.load_exr("picture.exr").items())}
        {'B': (6, 8), 'G': (6, 8), 'R': (6, 8)}
    """
    try:
        with open_exr(path) as file:
            channels = file.channels() if file.parts else {}
            found = {name: np.array(channel.pixels, dtype=np.float32) for name, channel in channels.items()}
    except Exception as error:
        raise ValueError(f"{path}: this OpenEXR file cannot be read ({error}); check the path") from error
    if not found:
        raise ValueError(f"{path}: is cut off or damaged; copy it again")
    return found


def _refuse_non_finite(path: Path | str, image: Float[Pixels, "h w 3"]) -> None:
    bad = int(np.sum(~np.isfinite(image)))
    if bad:
        raise ValueError(
            f"{Path(path).name}: {bad} values of the picture are not finite; nothing was written. Look for a"
            " light or an emission that is too bright"
        )


def png16(pixels: UInt16[np.ndarray, "h w 3"]) -> bytes:
    """An RGB PNG file of sRGB `pixels` (ISO/IEC 15948), each row stored without a filter."""
    height, width = pixels.shape[:2]
    rows = pixels.astype(">u2").reshape(height, width * 3).view(np.uint8)
    scanlines = np.concatenate([np.zeros((height, 1), np.uint8), rows], axis=1)
    bit_depth, truecolour, perceptual = 16, 2, 0
    return b"".join(
        [
            _PNG_SIGNATURE,
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bit_depth, truecolour, 0, 0, 0)),
            _chunk(b"sRGB", bytes([perceptual])),
            _chunk(b"IDAT", zlib.compress(scanlines.tobytes(), level=6)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
