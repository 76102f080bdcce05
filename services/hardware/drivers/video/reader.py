"""Reads a source: a live one all the time, so that its queue holds nothing old, a file one picture at a time."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
from numpy.typing import NDArray

from services.hardware.drivers.video.source import (
    SourceAway,
    SourceKind,
    WantedFormat,
    kernel_stamp_ns,
    opened,
    set_exposure,
    set_up,
)

KEPT = 8
AGAIN_S = 0.3  # between two attempts to open a source that is away
CLOSE_S = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class DecodedPicture:
    """A picture as OpenCV decodes it, and when it came, host's monotonic ns."""

    pixels: NDArray[Any]
    came_ns: int


class FileReader:
    """Pictures of a file, one after the other, the last one over again."""

    def __init__(self, source: str) -> None:
        self._capture = opened(source, SourceKind.FILE)
        self._last: NDArray[Any] | None = None
        self._source = source
        self.reconnects = 0

    def next(self) -> DecodedPicture:
        """The next picture. Raises SourceAway when there is not one."""
        there, pixels = self._capture.read()
        if there:
            self._last = pixels
        if self._last is None:
            raise SourceAway(f"{self._source} holds no picture that can be read")
        return DecodedPicture(self._last, time.monotonic_ns())

    def close(self) -> None:
        """Close the file."""
        self._capture.release()


class LiveReader:
    """A thread that takes each picture as it comes, and opens the source anew when it goes away.

    The first opening is the caller's: ConfigError and SourceAway come out of the constructor.
    """

    def __init__(self, source: str, kind: SourceKind, wanted: WantedFormat) -> None:
        self._source, self._kind, self._wanted = source, kind, wanted
        self._capture: cv2.VideoCapture | None = self._open()
        self._seen: deque[DecodedPicture] = deque(maxlen=KEPT)
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._exposure_s: float | None = None
        self.exposing_s = wanted.exposure_s
        self.reconnects = 0
        self._thread = threading.Thread(target=self._read, name=f"reads-{source}", daemon=True)
        self._thread.start()

    def _open(self) -> cv2.VideoCapture:
        capture = opened(self._source, self._kind)
        if self._kind is SourceKind.DEVICE:
            try:
                set_up(capture, self._wanted, self._source)
            except BaseException:
                capture.release()
                raise
        return capture

    @property
    def away(self) -> bool:
        """Whether the source does not answer now."""
        return self._capture is None

    def expose(self, exposure_s: float) -> None:
        """Ask for another exposure: the thread that reads sets it, between two pictures."""
        if self._kind is SourceKind.DEVICE and self._wanted.exposure_s is not None:
            with self._changed:
                self._exposure_s = exposure_s
                self._changed.wait_for(lambda: self._exposure_s is None or self.away, timeout=1.0)

    def seen_since(self, since_ns: int) -> list[DecodedPicture]:
        """What came at or after an instant, oldest first."""
        with self._changed:
            return [seen for seen in self._seen if seen.came_ns >= since_ns]

    def wait_for_another(self, timeout_s: float) -> None:
        """Until the next picture came, or the source went away, or the time is over."""
        with self._changed:
            self._changed.wait(max(0.0, timeout_s))

    def _read(self) -> None:
        while not self._stop.is_set():
            capture = self._capture
            if capture is None:
                self._open_again()
                continue
            with self._changed:
                if self._exposure_s is not None:
                    unit_s = self._wanted.exposure_unit_s
                    self.exposing_s = set_exposure(capture, self._exposure_s, unit_s, self._source, strict=False)
                    self._exposure_s = None
                    self._changed.notify_all()
            there, pixels = capture.read()
            now_ns = time.monotonic_ns()
            with self._changed:
                if there:
                    stamp_ns = kernel_stamp_ns(capture, self._kind, now_ns)
                    self._seen.append(DecodedPicture(pixels, now_ns if stamp_ns is None else stamp_ns))
                else:
                    capture.release()
                    self._capture = None
                self._changed.notify_all()
        if self._capture is not None:
            self._capture.release()

    def _open_again(self) -> None:
        try:
            capture = self._open()
        except Exception:  # whatever it says while it is coming back: the next attempt tells
            self._stop.wait(AGAIN_S)
            return
        with self._changed:
            self._capture, self.reconnects = capture, self.reconnects + 1
            self._seen.clear()
            self._changed.notify_all()

    def close(self) -> None:
        """End the thread; a picture that it waits for is waited for some seconds at the most."""
        self._stop.set()
        self._thread.join(CLOSE_S)
