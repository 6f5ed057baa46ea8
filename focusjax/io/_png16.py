"""PNG with 16 bits per channel, which the imaging libraries we use can read but not write."""

import struct
import zlib

import numpy as np
from jaxtyping import UInt16

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def png16(pixels: UInt16[np.ndarray, "h w 3"]) -> bytes:
    """An RGB PNG file of sRGB `pixels` (ISO/IEC 15948), each row stored without a filter."""
    height, width = pixels.shape[:2]
    rows = pixels.astype(">u2").reshape(height, width * 3).view(np.uint8)
    scanlines = np.concatenate([np.zeros((height, 1), np.uint8), rows], axis=1)
    bit_depth, truecolour, perceptual = 16, 2, 0
    return b"".join(
        [
            _SIGNATURE,
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bit_depth, truecolour, 0, 0, 0)),
            _chunk(b"sRGB", bytes([perceptual])),
            _chunk(b"IDAT", zlib.compress(scanlines.tobytes(), level=6)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
