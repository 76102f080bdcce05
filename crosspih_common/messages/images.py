"""Images on the bus are Foxglove protobuf as it stands, so that the payload is the recorded message."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IMAGE_TYPE = "foxglove.RawImage"


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """A picture: `pixels` is (height, width) grey or (height, width, 3) RGB, uint8; `stamp_ns` the cell's clock."""

    frame: str
    pixels: NDArray[np.uint8]
    stamp_ns: int = -1
    seq: int = -1

    @property
    def encoding(self) -> str:
        """`mono8` or `rgb8`."""
        return "mono8" if self.pixels.ndim == 2 else "rgb8"
