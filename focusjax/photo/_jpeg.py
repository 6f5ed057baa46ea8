"""XMP of JPEG files, as far as depth needs it: segments, extended XMP, and a parser without entities.

JPEG segments: marker 0xFF xx and a length of two bytes. XMP (Adobe, XMP Specification Part 3, section 1.1.3)
lies in APP1 segments; what is longer than 64 KB follows in segments of an MD5 name, the whole length and an
offset each. Dynamic Depth appends its pictures after the end of the primary one.
"""

import base64
import binascii
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

from focusjax.photo._errors import PhotoError

_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_EXTENDED = b"http://ns.adobe.com/xmp/extension/\0"
_GDEPTH = "http://ns.google.com/photos/1.0/depthmap/"
_DEPTH = "http://ns.google.com/photos/dd/1.0/depthmap/"
_ITEMS = ("http://ns.google.com/photos/dd/1.0/item/", "http://ns.google.com/photos/1.0/container/item/")
_CONTAINERS = (
    "http://ns.google.com/photos/dd/1.0/container/",
    "http://ns.google.com/photos/1.0/container/",
)
_LARGEST = 1 << 28
"""Bytes of extended XMP, at most."""
_ALONE = (0x01, *range(0xD0, 0xD8))
_START_OF_SCAN, _END, _APP1 = 0xDA, 0xD9, 0xE1


@dataclass
class JpegMetadata:
    """What XMP says of depth.

    Attributes:
        gdepth: properties of GDepth by name.
        dynamic: properties of the first depth map of Dynamic Depth by name.
        items: those of each item of the container, in order.
        end: byte after the primary picture.
    """

    gdepth: dict[str, str] = field(default_factory=dict)
    dynamic: dict[str, str] = field(default_factory=dict)
    items: list[dict[str, str]] = field(default_factory=list)
    end: int = 0


def jpeg_metadata(data: bytes, source: str) -> JpegMetadata:
    """What the XMP of a JPEG file says of depth; nothing where there is none.

    Raises:
        PhotoError: XMP that is damaged, or has entities or a document type.
    """
    standard, extended, end = _segments(data)
    found = JpegMetadata(end=end)
    for packet in (standard, extended):
        if packet:
            _parse(packet, found, source)
    return found


def _segments(data: bytes) -> tuple[bytes, bytes, int]:
    """The XMP packet, the extended one, and where the primary picture ends."""
    standard, extended = b"", bytearray()
    place = 2
    while place + 4 <= len(data):
        if data[place] != 0xFF:
            break
        marker = data[place + 1]
        if marker == 0xFF or marker in _ALONE:
            place += 1 if marker == 0xFF else 2
            continue
        if marker == _END:
            return standard, bytes(extended), place + 2
        length = int.from_bytes(data[place + 2 : place + 4])
        if length < 2:
            break
        body = data[place + 4 : place + 2 + length]
        place += 2 + length
        if marker == _APP1 and body.startswith(_XMP):
            standard = body[len(_XMP) :]
        elif marker == _APP1 and body.startswith(_EXTENDED):
            head = len(_EXTENDED) + 32
            whole, offset = (int.from_bytes(body[k : k + 4]) for k in (head, head + 4))
            if whole <= _LARGEST and offset + len(body) - head - 8 <= whole:
                if len(extended) < whole:
                    extended.extend(bytes(whole - len(extended)))
                extended[offset : offset + len(body) - head - 8] = body[head + 8 :]
        elif marker == _START_OF_SCAN:
            place = _after_scan(data, place)
    return standard, bytes(extended), place


def _after_scan(data: bytes, place: int) -> int:
    """The next marker that is no restart and no stuffed byte."""
    while True:
        place = data.find(b"\xff", place)
        if place < 0 or place + 1 >= len(data):
            return len(data)
        if data[place + 1] != 0 and data[place + 1] not in _ALONE:
            return place
        place += 2


def _parse(packet: bytes, found: JpegMetadata, source: str) -> None:
    """Properties as attributes or as elements, whichever way they are nested."""
    parser = expat.ParserCreate(namespace_separator=" ")
    names: list[str] = []
    texts: list[list[str]] = []

    def refuse(*_: object) -> NoReturn:
        raise PhotoError(
            f"{source}: its XMP declares a document type or an entity, which no camera does; it is not read,"
            " so save the photograph without metadata and give its depth as a file"
        )

    def take(name: str, value: str) -> None:
        space, _, local = name.rpartition(" ")
        if space == _GDEPTH:
            found.gdepth.setdefault(local, value)
        elif space == _DEPTH:
            found.dynamic.setdefault(local, value)
        elif space in _ITEMS and found.items:
            found.items[-1][local] = value

    def start(name: str, attributes: dict[str, str]) -> None:
        space, _, local = name.rpartition(" ")
        if space in _CONTAINERS and local == "Item":
            found.items.append({})
        names.append(name)
        texts.append([])
        for key, value in attributes.items():
            take(key, value)

    def end(name: str) -> None:
        text = "".join(texts.pop()).strip()
        names.pop()
        if text:
            take(name, text)

    def characters(text: str) -> None:
        if texts:
            texts[-1].append(text)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.UnparsedEntityDeclHandler = refuse
    parser.ExternalEntityRefHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = characters
    parser.buffer_text = True
    try:
        parser.Parse(packet.rstrip(b"\0"), True)
    except expat.ExpatError as error:
        if found.gdepth or found.dynamic or b"epthmap" in packet:
            raise PhotoError(f"{source}: its XMP is damaged ({error}); export it again") from error


def decoded_base64(text: str, what: str) -> bytes:
    """Bytes of base64 with or without its padding.

    Raises:
        PhotoError: something else.
    """
    plain = "".join(text.split())
    try:
        return base64.b64decode(plain + "=" * (-len(plain) % 4), validate=True)
    except binascii.Error as error:
        raise PhotoError(f"{what} is no base64 ({error}); export the photograph again") from error
