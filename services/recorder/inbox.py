"""The bounded queue between the bus's callbacks and the writer."""

from __future__ import annotations

import threading
import time
from collections import deque

from services.recorder.sample import Sample


class Inbox:
    """Holds at most so many samples and bytes; a full inbox refuses at once, so that no callback ever waits."""

    def __init__(self, max_samples: int, max_bytes: int) -> None:
        self._max_samples, self._max_bytes = max_samples, max_bytes
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._waiting: deque[Sample] = deque()
        self._bytes = 0
        self._offered = 0
        self._settled = 0
        self._closed = False

    def offer(self, sample: Sample) -> bool:
        """Enqueue; False when full."""
        with self._lock:
            if len(self._waiting) >= self._max_samples or self._bytes + len(sample.payload) > self._max_bytes:
                return False
            if not self._waiting:  # the writer waits for nothing else
                self._changed.notify_all()
            self._waiting.append(sample)
            self._bytes += len(sample.payload)
            self._offered += 1
        return True

    def take(self, timeout_s: float) -> list[Sample]:
        """All that waits, oldest first; an empty list at the time-out or when closed. Follow with `settle`."""
        with self._changed:
            if not self._waiting and not self._closed:
                self._changed.wait(timeout_s)
            batch = list(self._waiting)
            self._waiting.clear()
            self._bytes = 0
            return batch

    def settle(self, count: int) -> None:
        """Say that so many of the taken samples are dealt with."""
        with self._changed:
            self._settled += count
            self._changed.notify_all()

    def drain(self, deadline_s: float) -> bool:
        """Wait until all that was offered before this call is dealt with; False when that takes longer."""
        until = time.monotonic() + deadline_s
        with self._changed:
            target = self._offered
            while self._settled < target:
                left = until - time.monotonic()
                if left <= 0.0:
                    return False
                self._changed.wait(left)
        return True

    @property
    def closed(self) -> bool:
        """Whether the writer should end."""
        return self._closed

    def close(self) -> None:
        """Wake the writer for the last time."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
