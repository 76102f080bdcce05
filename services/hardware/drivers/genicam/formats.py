"""Pixel formats of GenICam (PFNC) as encodings of docs/wire.md, and the bytes of a picture as an array. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.messages.images import ENCODINGS, Pixels


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """A format: its PFNC name, and the encoding that its pixels have on the bus."""

    name: str
    encoding: str


# "GenICam Pixel Format Values", EMVA: bits a pixel stand in the second byte; 10 to 14 bits lie in the low bits of 16
FORMATS = {
    0x01080001: PixelFormat("Mono8", "mono8"),
    0x01100003: PixelFormat("Mono10", "mono16"),
    0x01100005: PixelFormat("Mono12", "mono16"),
    0x01100025: PixelFormat("Mono14", "mono16"),
    0x01100007: PixelFormat("Mono16", "mono16"),
    0x02180014: PixelFormat("RGB8", "rgb8"),
    0x02180015: PixelFormat("BGR8", "bgr8"),
    **{0x01080008 + n: PixelFormat(f"Bayer{p.upper()}8", f"bayer_{q}8") for n, (p, q) in enumerate(
        (("gr", "grbg"), ("rg", "rggb"), ("gb", "gbrg"), ("bg", "bggr")))},
    **{base + n: PixelFormat(f"Bayer{p.upper()}{bits}", f"bayer_{q}16")
       for base, bits in ((0x0110000C, 10), (0x01100010, 12), (0x0110002E, 16))
       for n, (p, q) in enumerate((("gr", "grbg"), ("rg", "rggb"), ("gb", "gbrg"), ("bg", "bggr")))},
}  # fmt: skip
# names of before PFNC 2.0 that cameras still use
OLD_NAMES = {"RGB8Packed": "RGB8", "BGR8Packed": "BGR8"}
NAMES = {known.name: code for code, known in FORMATS.items()}


def code_of(name: str) -> int | None:
    """The code of a format's name; None of one that has no encoding, such as Mono12Packed."""
    return NAMES.get(OLD_NAMES.get(name, name))


def pixels_of(data: bytes, code: int, width_px: int, height_px: int, row_padding: int = 0) -> tuple[Pixels, str]:
    """The picture, (height, width) or (height, width, 3), and its encoding. Raises ValueError where it does not fit."""
    known = FORMATS.get(code)
    if known is None:
        raise ValueError(f"pixel format 0x{code:08x} has no encoding; set one of {', '.join(NAMES)}")
    kind, channels = ENCODINGS[known.encoding]
    dtype = np.dtype(kind)
    row = width_px * channels * dtype.itemsize
    if len(data) < (row + row_padding) * height_px - row_padding:
        raise ValueError(f"{len(data)} bytes are no {width_px} x {height_px} of {known.name}")
    rows = np.frombuffer(data.ljust((row + row_padding) * height_px, b"\0"), dtype=np.uint8)
    rows = rows[: (row + row_padding) * height_px].reshape(height_px, row + row_padding)[:, :row]
    pixels = np.ascontiguousarray(rows).view(dtype)
    shape = (height_px, width_px, channels) if channels > 1 else (height_px, width_px)
    return pixels.reshape(shape), known.encoding
