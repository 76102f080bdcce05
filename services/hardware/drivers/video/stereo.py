"""Two video sources, or both sides in one picture, as a stereo pair: fresh, of the right size, near enough in time."""

from __future__ import annotations

import threading
import time
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.messages import CameraCalibration
from crosspih_common.messages.images import Pixels
from services.hardware.drivers.video.config import VideoConfig
from services.hardware.drivers.video.reader import DecodedPicture, FileReader, LiveReader
from services.hardware.drivers.video.source import FIELD, SourceAway, WantedFormat, kind_of
from services.hardware.protocols import StereoCapture


class VideoPair:
    """Implements CameraDevice. Raises ConfigError when a source is not there or not as the calibration says."""

    def __init__(self, config: VideoConfig, calibration: CameraCalibration) -> None:
        self._config, self._calibration = config, calibration
        self.exposure_s = config.exposure_s
        self.apart_s = 0.0  # of the last pair, by when its pictures came
        self._exposure_set_s = config.exposure_s
        self._lock = threading.Lock()
        self._readers: list[LiveReader | FileReader] = []
        sides = (("left", config.left), ("right", config.right))
        kinds = {kind_of(source, side) for side, source in sides if source is not None}
        if len({kind.live for kind in kinds}) > 1:
            raise ConfigError(f"{FIELD}.left, right: one is a file, the other goes on by itself; want both alike")
        self.live = all(kind.live for kind in kinds)
        try:
            for side, source in sides:
                if source is not None:
                    self._readers.append(self._reader(side, source))
            self._first_look()
        except SourceAway as away:
            self.close()
            raise ConfigError(f"{FIELD}: {away}") from None
        except BaseException:
            self.close()
            raise

    def _reader(self, side: str, source: str) -> LiveReader | FileReader:
        kind = kind_of(source, side)
        return (
            LiveReader(source, kind, WantedFormat.of(self._config, self._whole(side)))
            if kind.live
            else FileReader(source)
        )

    def _whole(self, side: str) -> tuple[int, int]:
        """The size of a source's picture, by the calibration."""
        left, right = self._calibration.left, self._calibration.right
        if self._config.right is None:
            return left.width_px + right.width_px, max(left.height_px, right.height_px)
        lens = left if side == "left" else right
        return lens.width_px, lens.height_px

    def _first_look(self) -> None:
        """A picture of each source against the calibration; a file's is kept for the first capture."""
        self._held: list[DecodedPicture] | None = self._fresh(time.monotonic_ns(), self._config.frame_wait_s)
        for side, seen in zip(("left", "right"), self._held, strict=False):
            self._check_size(side, seen.pixels)
        if self.live:
            self._held = None

    def _check_size(self, side: str, pixels: NDArray[Any]) -> None:
        wanted, size = self._whole(side), (pixels.shape[1], pixels.shape[0])
        if size != wanted:
            both = "both sides beside each other, " if self._config.right is None else ""
            raise ConfigError(
                f"{FIELD}.calibration: {getattr(self._config, side)} gives {size[0]} x {size[1]}, the calibration says "
                f"{both}{wanted[0]} x {wanted[1]}; calibrate at the size that is delivered"
            )

    def calibration(self) -> CameraCalibration:
        """As the file says it."""
        return self._calibration

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """A pair that was exposed after now; of files the next one. There are no lamps.

        Raises CommandRefused: camera_away, stale_picture, exposed_apart.
        """
        with self._lock:
            exposure_s = self._expose(self.exposure_s * exposure_scale)
            asked_ns = time.monotonic_ns()
            late_ns = round((self._config.delay_s + exposure_s) * 1e9) if self.live else 0
            until_s = time.monotonic() + self._config.patience_s
            while True:
                try:
                    seen = self._held or self._fresh(asked_ns + late_ns, self._config.frame_wait_s + late_ns * 1e-9)
                    self._held = None
                    for side, one in zip(("left", "right"), seen, strict=False):
                        self._check_size(side, one.pixels)
                    break
                except SourceAway as away:
                    if time.monotonic() >= until_s:
                        waited = f"; waited {self._config.patience_s:g} s" if self.live else ""
                        raise CommandRefused("camera_away", f"{away}{waited}") from None
                except ConfigError as error:
                    raise CommandRefused("camera_away", str(error)) from None
        left, right = self._both(seen)
        began_ns = min(one.came_ns for one in seen) - late_ns
        return StereoCapture(-1, exposure_s, left, right, host_ns=max(asked_ns, began_ns))

    def _expose(self, wanted_s: float) -> float:
        """Another exposure where the source can; the one that there is, s."""
        live = [reader for reader in self._readers if isinstance(reader, LiveReader)]
        if wanted_s != self._exposure_set_s:
            for reader in live:
                reader.expose(wanted_s)
                for _ in range(self._config.settle_frames):
                    reader.wait_for_another(self._config.frame_wait_s)
            self._exposure_set_s = wanted_s
        exposing = [reader.exposing_s for reader in live if reader.exposing_s is not None]
        return max(exposing, default=self.exposure_s)

    def _fresh(self, since_ns: int, wait_s: float) -> list[DecodedPicture]:
        """A picture of each source that came since. Raises SourceAway, CommandRefused."""
        if not self.live:
            return [reader.next() for reader in self._readers if isinstance(reader, FileReader)]
        readers = [reader for reader in self._readers if isinstance(reader, LiveReader)]
        until_s = time.monotonic() + wait_s
        apart_ns: int | None = None
        while True:
            found = [reader.seen_since(since_ns) for reader in readers]
            if all(found):
                pair = min(
                    ([one, other] for one in found[0] for other in found[-1]),
                    key=lambda pair: abs(pair[0].came_ns - pair[1].came_ns),
                )
                apart_ns = abs(pair[0].came_ns - pair[1].came_ns)
                if apart_ns <= self._config.skew_most_s * 1e9:
                    self.apart_s = apart_ns * 1e-9
                    return pair[: len(readers)]
            away = [reader for reader in readers if reader.away]
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                if apart_ns is not None:
                    raise CommandRefused(
                        "exposed_apart",
                        f"the nearest pictures of both sides came {apart_ns * 1e-6:.1f} ms apart; {FIELD}.skew_most_s "
                        f"allows {self._config.skew_most_s * 1e3:g} ms: raise it where nothing moves, or the rate",
                    )
                names = (self._config.left, self._config.right)
                silent = [name for name, seen in zip(names, found, strict=False) if not seen]
                text = (
                    f"{', '.join(map(str, silent))} {'is away' if away else f'gave no picture within {wait_s:.1f} s'}"
                )
                raise SourceAway(text)
            (away or readers)[0].wait_for_another(min(left_s, 0.1))

    def _both(self, seen: list[DecodedPicture]) -> tuple[Pixels, Pixels]:
        if len(seen) == 2:
            return self._coded(seen[0].pixels), self._coded(seen[1].pixels)
        left, right = self._calibration.left, self._calibration.right
        whole = self._coded(seen[0].pixels)
        return (
            np.ascontiguousarray(whole[: left.height_px, : left.width_px]),
            np.ascontiguousarray(whole[: right.height_px, left.width_px :]),
        )

    def _coded(self, pixels: NDArray[Any]) -> Pixels:
        """Grey or RGB of what OpenCV decodes as grey or BGR."""
        if pixels.ndim == 2:
            return np.asarray(pixels, dtype=np.uint8)
        code = cv2.COLOR_BGR2RGB if self._config.colour else cv2.COLOR_BGR2GRAY
        return np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)

    def close(self) -> None:
        """Let go of the sources."""
        for reader in self._readers:
            reader.close()
        self._readers = []
