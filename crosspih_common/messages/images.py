"""Images on the bus are Foxglove protobuf as it stands, so that the payload is the recorded message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:  # as in base.py
    import numpy as np
    from numpy.typing import NDArray

IMAGE_TYPE = "foxglove.RawImage"
BAYER = ("rggb", "bggr", "gbrg", "grbg")  # the colours of the top left 2 x 2 pixels, row by row
# number type of a sample on the wire, and channels
ENCODINGS: dict[str, tuple[str, int]] = {
    "mono8": ("u1", 1),
    "mono16": ("<u2", 1),
    "mono16be": (">u2", 1),  # decoded to mono16
    "rgb8": ("u1", 3),
    "bgr8": ("u1", 3),
    **{f"bayer_{pattern}8": ("u1", 1) for pattern in BAYER},
    **{f"bayer_{pattern}16": ("<u2", 1) for pattern in BAYER},
}

Pixels: TypeAlias = "NDArray[np.unsignedinteger[Any]]"


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """A picture: `pixels` is (height, width) or (height, width, 3), uint8 or uint16; `stamp_ns` the cell's clock.

    `encoding` is one of ENCODINGS; left out it is `mono8`, `mono16` or `rgb8` by the shape and number type of `pixels`.
    """

    frame: str
    pixels: Pixels
    stamp_ns: int = -1
    seq: int = -1
    encoding: str = ""

    def __post_init__(self) -> None:
        """ValueError where the pixels are not what the encoding says."""
        depth = {"uint8": 8, "uint16": 16}.get(self.pixels.dtype.name, 0)
        colour = self.pixels.ndim == 3
        encoding = self.encoding or (f"rgb{depth}" if colour else f"mono{depth}")
        kind, channels = ENCODINGS.get(encoding, ("u0", 0))
        shape = self.pixels.shape[2:] if colour else (1,)
        if kind[-1] != str(depth // 8) or shape != (channels,) or self.pixels.ndim not in (2, 3):
            raise ValueError(
                f"pixels {self.pixels.shape} {self.pixels.dtype} are not {encoding}; encodings: {', '.join(ENCODINGS)}"
            )
        object.__setattr__(self, "encoding", encoding)
