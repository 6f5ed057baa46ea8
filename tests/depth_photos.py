"""Photographs with depth that tests make: a disk before a wall, and phone files with their depth inside.

HEIC: two pictures are encoded as single frames of HEVC by the ffmpeg that imageio-ffmpeg brings, and put into
the boxes of ISO/IEC 23008-12: the picture, and a depth map that refers to it (`auxl`), whose `auxC` box says
between which disparities its values lie (the SEI message 177 of HEVC).
"""

import base64
import hashlib
import io
import struct
import subprocess
import zlib

import imageio_ffmpeg
import numpy as np
from PIL import Image

XMP, EXTENDED = b"http://ns.adobe.com/xap/1.0/\0", b"http://ns.adobe.com/xmp/extension/\0"
NEAR_M, FAR_M = 0.5, 2.0


def disk_scene(width=48, height=36):
    """sRGB bytes [h, w, 3] of a red disk before a checkered wall, and depth [h, w] in metres."""
    y, x = np.mgrid[:height, :width] + 0.5
    disk = np.hypot(x - width / 2, y - height / 2) < height / 4
    checks = ((x // 6 + y // 6) % 2)[..., None] * np.array([90, 90, 60]) + np.array([60, 70, 80])
    picture = np.where(disk[..., None], np.array([220, 40, 30]), checks).astype(np.uint8)
    return picture, np.where(disk, NEAR_M, FAR_M)


def jpeg(picture, exif=None):
    """A JPEG file of a picture."""
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "JPEG", quality=97, subsampling=0, **({"exif": exif} if exif else {}))
    return out.getvalue()


def png(values):
    """A PNG file of greys."""
    out = io.BytesIO()
    Image.fromarray(values).save(out, "PNG")
    return out.getvalue()


def with_segments(data, segments):
    """A JPEG file with APP1 segments after its start."""
    parts = [b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body for body in segments]
    return data[:2] + b"".join(parts) + data[2:]


def png16(values):
    """A PNG file of 16-bit samples [h, w, c], of 1 to 4 channels."""
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[values.shape[2]]
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    head = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], 16, kind, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in parts
    )


def range_inverse(depth):
    """Stored greys of a depth map between `NEAR_M` and `FAR_M`: 0 is near."""
    share = (1 / NEAR_M - 1 / depth) / (1 / NEAR_M - 1 / FAR_M)
    return np.round(255 * share).astype(np.uint8)


def description(attributes, inside=""):
    """An XMP packet with one description."""
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {attributes}>{inside}</rdf:Description></rdf:RDF></x:xmpmeta>'
    ).encode()


def gdepth_jpeg(picture, depth, units="m", per_metre=1, extended=False, measure=None, exif=None):
    """A JPEG with GDepth, its map in the first packet or in extended XMP of several segments."""
    data = base64.b64encode(png(range_inverse(depth))).decode()
    space = 'xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/"'
    said = (
        f'{space} GDepth:Format="RangeInverse" GDepth:Near="{NEAR_M * per_metre}"'
        f' GDepth:Far="{FAR_M * per_metre}"'
        f' GDepth:Mime="image/png" GDepth:Units="{units}"'
    )
    if measure:
        said += f' GDepth:MeasureType="{measure}"'
    if not extended:
        return with_segments(jpeg(picture, exif), [XMP + description(f'{said} GDepth:Data="{data}"')])
    more = description(f'{space} GDepth:Data="{data}"')
    name = hashlib.md5(more).hexdigest().upper().encode()
    pieces = [
        EXTENDED + name + struct.pack(">II", len(more), start) + more[start : start + 100]
        for start in range(0, len(more), 100)
    ]
    return with_segments(jpeg(picture), [XMP + description(said), *pieces])


def dynamic_depth_jpeg(picture, depth, cut=0, measure="OpticalAxis"):
    """A Dynamic Depth JPEG: another picture and then the map follow the primary one."""
    other, depth_map = jpeg(picture[:8, :8]), png(range_inverse(depth))
    items = "".join(
        f'<rdf:li rdf:parseType="Resource"><Container:Item Item:Mime="{mime}" Item:Length="{length}"'
        f' Item:Padding="{padding}" Item:DataURI="{uri}"/></rdf:li>'
        for mime, length, padding, uri in (
            ("image/jpeg", 0, 5, "primary_image"),
            ("image/jpeg", len(other), 0, "android/original"),
            ("image/png", len(depth_map), 0, "android/depthmap"),
        )
    )
    inside = (
        f"<Device:Container><Container:Directory><rdf:Seq>{items}</rdf:Seq></Container:Directory>"
        '</Device:Container><Camera:DepthMap DepthMap:Format="RangeInverse" DepthMap:Units="Meters"'
        f' DepthMap:Near="{NEAR_M}" DepthMap:Far="{FAR_M}" DepthMap:DepthURI="android/depthmap"'
        f' DepthMap:MeasureType="{measure}"/>'
    )
    base = "http://ns.google.com/photos/dd/1.0/"
    spaces = " ".join(
        f'xmlns:{name}="{base}{name.lower()}/"'
        for name in ("Device", "Camera", "Container", "Item", "DepthMap")
    )
    primary = with_segments(jpeg(picture), [XMP + description(spaces, inside)])
    whole = primary + b"\0" * 5 + other + depth_map
    return whole[: len(whole) - cut]


def heic(picture, depth_greys=None, d_min=1 / FAR_M, d_max=1 / NEAR_M, kind=0):
    """A HEIC file with a depth map of disparities in 1/m, if there is one."""
    size = picture.shape[1], picture.shape[0]
    units = [_hevc(picture, "rgb24", size)]
    sizes = [size]
    if depth_greys is not None:
        sizes.append((depth_greys.shape[1], depth_greys.shape[0]))
        units.append(_hevc(depth_greys, "gray", sizes[1]))
    properties, owned, samples = [], [], []
    for number, nals in enumerate(units):
        sets = [nal for nal in nals if nal[0] >> 1 & 63 in (32, 33, 34)]
        slices = [nal for nal in nals if nal[0] >> 1 & 63 < 32]
        samples.append(b"".join(struct.pack(">I", len(nal)) + nal for nal in slices))
        mine = [_hvcc(sets, 0 if number else 1), _full(b"ispe", struct.pack(">II", *sizes[number]))]
        if number:
            sei = _depth_sei(d_min, d_max, kind)
            lengths = struct.pack(">II", len(sei) + 4, len(sei))
            mine.append(_full(b"auxC", b"urn:mpeg:hevc:2015:auxid:2\0" + lengths + sei))
        owned.append(range(len(properties) + 1, len(properties) + 1 + len(mine)))
        properties += mine
    count = len(units)
    infe = b"".join(
        _full(b"infe", struct.pack(">HH4s", k + 1, 0, b"hvc1") + b"\0", version=2) for k in range(count)
    )
    ipma = struct.pack(">I", count) + b"".join(
        struct.pack(">HB", k + 1, len(owned[k])) + bytes(0x80 * (n == owned[k][0]) | n for n in owned[k])
        for k in range(count)
    )
    auxl = _box(b"auxl", struct.pack(">HHH", 2, 1, 1)) if count > 1 else b""

    def meta(start):
        places, offset = b"", start
        for k, sample in enumerate(samples):
            places += struct.pack(">HHHII", k + 1, 0, 1, offset, len(sample))
            offset += len(sample)
        return _full(
            b"meta",
            _full(b"hdlr", struct.pack(">I4s12x", 0, b"pict") + b"\0")
            + _full(b"pitm", struct.pack(">H", 1))
            + _full(b"iloc", struct.pack(">BBH", 0x44, 0, count) + places)
            + _full(b"iinf", struct.pack(">H", count) + infe)
            + (_full(b"iref", auxl) if auxl else b"")
            + _box(b"iprp", _box(b"ipco", b"".join(properties)) + _full(b"ipma", ipma)),
        )

    head = _box(b"ftyp", b"heic" + struct.pack(">I", 0) + b"mif1heic")
    start = len(head) + len(meta(0)) + 8
    return head + meta(start) + _box(b"mdat", b"".join(samples))


def _box(kind, body):
    return struct.pack(">I", len(body) + 8) + kind + body


def _full(kind, body, version=0):
    return _box(kind, struct.pack(">B3x", version) + body)


def _hevc(values, form, size):
    """NAL units of one frame."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", form]
    command += ["-s", f"{size[0]}x{size[1]}", "-i", "-", "-frames:v", "1", "-c:v", "libx265", "-pix_fmt"]
    command += [
        "gray" if form == "gray" else "yuv420p",
        "-x265-params",
        "crf=2:log-level=none:info=0:range=full",
        "-f",
        "hevc",
        "-",
    ]
    stream = subprocess.run(command, input=values.tobytes(), capture_output=True, check=True).stdout
    found = [part.rstrip(b"\0") for part in stream.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1")]
    return [nal for nal in found if nal]


def _hvcc(sets, chroma):
    """The decoder configuration: general profile from the sequence parameter set, then all sets."""
    sps = next(nal for nal in sets if nal[0] >> 1 & 63 == 33)
    profile = sps[3:15].replace(b"\0\0\3", b"\0\0")[:12].ljust(12, b"\0")
    body = b"\1" + profile + struct.pack(">HBBBBHB", 0xF000, 0xFC, 0xFC | chroma, 0xF8, 0xF8, 0, 0x0F)
    body += bytes([len(sets)])
    for nal in sets:
        body += bytes([0x80 | (nal[0] >> 1 & 63)]) + struct.pack(">HH", 1, len(nal)) + nal
    return _box(b"hvcC", body)


def _depth_sei(d_min, d_max, kind):
    """The SEI message of depth representation information as a NAL unit (G.7.3.2.x: flags, then numbers)."""
    bits = "0011" + _ue(kind) + _ue(0) + _number(d_min) + _number(d_max)
    bits += "1" + "0" * (-(len(bits) + 1) % 8)
    body = int(bits, 2).to_bytes(len(bits) // 8)
    return bytes([39 << 1, 1, 177, len(body)]) + body


def _ue(value):
    text = f"{value + 1:b}"
    return "0" * (len(text) - 1) + text


def _number(value):
    """Sign, exponent and 32 bits of mantissa."""
    exponent = int(np.floor(np.log2(abs(value))))
    mantissa = round((abs(value) / 2.0**exponent - 1.0) * 2**32)
    return f"{int(value < 0)}{exponent + 31:07b}{31:05b}{mantissa:032b}"
