"""A camera's clock against the host's, by windows: an event that the camera stamped fell between two host times. Pure.

Nothing is fitted: each window bounds the offset from both sides, and what all windows allow is the offset and how far
it may be off. Older windows are widened by as much as two clocks may part meanwhile. Where no offset is left the
camera's clock was set or its counter began anew, and the newest window alone counts.
"""

from __future__ import annotations

from collections import deque

DRIFT = 1e-4  # between camera and host; quartz is 5e-5 at worst
KEPT = 64


class WindowClock:
    """Maps a camera's stamps, ns, to the host's monotonic clock, ns, and says how far that may be off."""

    def __init__(self) -> None:
        self._windows: deque[tuple[int, int, int]] = deque(maxlen=KEPT)  # camera's stamp, host's earliest and latest
        self.restarts = 0

    @property
    def ready(self) -> bool:
        """Whether anything is known."""
        return bool(self._windows)

    def observe(self, camera_ns: int, earliest_ns: int, latest_ns: int) -> None:
        """What the camera stamped so happened between these two times of the host."""
        if latest_ns < earliest_ns:
            raise ValueError("the latest time is before the earliest")
        self._windows.append((camera_ns, earliest_ns, latest_ns))
        low, high = self._bounds(camera_ns)
        if low > high:
            self._windows.clear()
            self._windows.append((camera_ns, earliest_ns, latest_ns))
            self.restarts += 1

    def _bounds(self, camera_ns: int) -> tuple[float, float]:
        low, high = -float("inf"), float("inf")
        for stamp_ns, earliest_ns, latest_ns in self._windows:
            apart_ns = DRIFT * abs(camera_ns - stamp_ns)
            low = max(low, earliest_ns - stamp_ns - apart_ns)
            high = min(high, latest_ns - stamp_ns + apart_ns)
        return low, high

    def host_ns(self, camera_ns: int) -> tuple[int, int]:
        """The host's time of a camera's stamp and how far it may be off, ns. Raises ValueError before any window."""
        if not self._windows:
            raise ValueError("nothing was observed of this clock yet")
        low, high = self._bounds(camera_ns)
        return camera_ns + round((low + high) / 2), max(0, round((high - low) / 2))
