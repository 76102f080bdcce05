"""The source of the rendered cameras' pictures, a cell on the bus or files; and one pair for two cameras."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.bus import Bus
from crosspih_common.errors import ConfigError
from crosspih_common.keys import CAPTURE, IMAGE_LEFT, IMAGE_RIGHT
from crosspih_common.messages import CaptureStereo
from crosspih_common.messages.images import Pixels

PAIR_S = 0.5  # triggers of both cameras within this time belong to one pair
CAPTURE_S, IMAGE_S = 30.0, 5.0


class FrameSource(Protocol):
    """Gives a pair of pictures as the cameras would take it now."""

    def pair(self, exposure_scale: float, lamp: int) -> tuple[Pixels, Pixels]:
        """Left and right, (height, width) or (height, width, 3) RGB, 8 bits, at a factor on the usual exposure."""


class CellFrames:
    """Pictures of another cell on the same router: each pair is a capture there, its own exposure times the factor."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._images = bus.latest(IMAGE_LEFT, 2), bus.latest(IMAGE_RIGHT, 2)

    def pair(self, exposure_scale: float, lamp: int) -> tuple[Pixels, Pixels]:
        """A capture. Raises CrosspihError when the other cell refuses, ConfigError when a picture does not come."""
        taken = self._bus.call(CAPTURE, CaptureStereo(exposure_scale=exposure_scale, lamp=lamp), CAPTURE_S)
        found = [latest.wait_for(lambda image: image.stamp_ns == taken.stamp_ns, IMAGE_S) for latest in self._images]
        if found[0] is None or found[1] is None:
            raise ConfigError(f"{self._bus.cell}: its pictures of capture {taken.capture_id} did not come")
        return found[0].pixels, found[1].pixels


class FileFrames:
    """Pictures from two lists of files: each shot uses the next pair, and repeats the last one at the end; a longer
    exposure is brighter, as on a sensor.
    """

    def __init__(self, left: Sequence[Path], right: Sequence[Path]) -> None:
        if not left or len(left) != len(right):
            raise ConfigError(f"{len(left)} left and {len(right)} right pictures; want as many of both, one or more")
        self._pairs = [(_read(one), _read(other)) for one, other in zip(left, right, strict=True)]
        self._next = 0

    @classmethod
    def of_folder(cls, folder: Path) -> FileFrames:
        """left*.png and right*.png of a folder, in the order of their names."""
        return cls(sorted(folder.glob("left*.png")), sorted(folder.glob("right*.png")))

    def pair(self, exposure_scale: float, lamp: int) -> tuple[Pixels, Pixels]:
        """The next pair."""
        left, right = self._pairs[min(self._next, len(self._pairs) - 1)]
        self._next += 1
        return _brighter(left, exposure_scale), _brighter(right, exposure_scale)


class SharedPair:
    """One shot for two cameras: the camera triggered first takes it, the other one gets its half of the same shot."""

    def __init__(self, source: FrameSource) -> None:
        self._source = source
        self._lock = threading.Lock()
        self._halves: dict[str, Pixels] = {}
        self._taken_s = -PAIR_S
        self.shots = 0

    def half(self, side: str, exposure_scale: float, lamp: int, triggered_s: float) -> Pixels:
        """The picture of one side; `triggered_s` is the time of its trigger on any one clock."""
        with self._lock:
            if side not in self._halves or abs(triggered_s - self._taken_s) > PAIR_S:
                left, right = self._source.pair(exposure_scale, lamp)
                self._halves = {"left": left, "right": right}
                self._taken_s = triggered_s
                self.shots += 1
            return self._halves.pop(side)


# of the pixels in the top left 2 x 2, row by row: 0 red, 1 green, 2 blue
MOSAICS = {"RG": (0, 1, 1, 2), "GR": (1, 0, 2, 1), "GB": (1, 2, 0, 1), "BG": (2, 1, 1, 0)}


def as_format(pixels: Pixels, name: str) -> NDArray[Any]:
    """An 8 bit picture, grey or RGB, in the pixel format of a sensor."""
    colour = pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2)
    if name == "RGB8":
        return colour
    if name.startswith("Bayer"):
        grey = np.empty(colour.shape[:2], dtype=np.uint8)
        for index, channel in enumerate(MOSAICS[name[5:7]]):
            row, column = divmod(index, 2)
            grey[row::2, column::2] = colour[row::2, column::2, channel]
        bits = int(name[7:])
    else:
        grey = np.asarray(pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
        bits = int(name[4:])
    return grey if bits == 8 else (grey.astype(np.float64) * ((2**bits - 1) / 255.0)).round().astype("<u2")


def _read(path: Path) -> Pixels:
    read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if read is None or read.dtype != np.uint8:
        raise ConfigError(f"{path}: is no picture of 8 bits")
    return np.asarray(cv2.cvtColor(read[..., :3], cv2.COLOR_BGR2RGB) if read.ndim == 3 else read, dtype=np.uint8)


def _brighter(pixels: Pixels, scale: float) -> Pixels:
    if scale == 1.0:
        return pixels
    return np.clip(np.round(pixels.astype(np.float64) * scale), 0, 255).astype(np.uint8)
