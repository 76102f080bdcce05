"""The bounded queue between the bus's callbacks and the writer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from services.recorder.sample import Waiting

SMALL_BYTES = 4096  # smaller samples are not counted by bytes: the limit on the number of samples bounds them


class Inbox:
    """Holds a limited number of samples, and a limited number of bytes of large ones. A full inbox refuses at once, so
    that no callback ever waits. Small samples are added without a lock: the lock would cost more than everything else
    here.
    """

    def __init__(self, max_samples: int, max_bytes: int) -> None:
        self._max_samples, self._max_bytes = max_samples, max_bytes
        self._lock = threading.Lock()
        self._settling = threading.Condition(self._lock)
        self._waiting: list[Waiting] = []  # any thread appends to it, only the writer empties it
        self._large_bytes = 0
        self._asleep = False
        self._wake = threading.Event()
        self._taken = 0
        self._settled = 0
        self._closed = False

    def offerer(self) -> Callable[[Waiting, int], bool]:
        """A function for any thread that enqueues (sample, its bytes) and returns False when full. Threads that call it
        at the same time may each find the last place free.
        """
        waiting, append, most = self._waiting, self._waiting.append, self._max_samples

        def offer(sample: Waiting, size: int) -> bool:
            if len(waiting) >= most or (size > SMALL_BYTES and not self._has_room(size)):
                return False
            append(sample)
            if self._asleep:
                self._wake.set()
            return True

        return offer

    def _has_room(self, size: int) -> bool:
        with self._lock:
            if self._large_bytes + size > self._max_bytes:
                return False
            self._large_bytes += size
            return True

    def take(self, timeout_s: float) -> list[Waiting]:
        """All waiting samples, oldest first; none at the time-out or when closed. Follow with `settle`. Only the
        writer's thread calls it.
        """
        self._asleep = True  # from now on whoever enqueues wakes this thread
        if not self._waiting and not self._closed:
            self._wake.wait(timeout_s)
        self._asleep = False
        self._wake.clear()
        with self._lock:
            batch = self._waiting[:]
            self._taken += len(batch)
            del self._waiting[: len(batch)]
            if self._large_bytes:
                self._large_bytes -= sum(size for sample in batch if (size := len(sample[2])) > SMALL_BYTES)
            return batch

    def settle(self, count: int) -> None:
        """Report that so many of the taken samples are dealt with."""
        with self._settling:
            self._settled += count
            self._settling.notify_all()

    def drain(self, deadline_s: float) -> bool:
        """Wait until everything offered before this call is dealt with; False when that takes longer
        than the time-out.
        """
        until = time.monotonic() + deadline_s
        with self._settling:
            target = self._taken + len(self._waiting)
            while self._settled < target:
                left = until - time.monotonic()
                if left <= 0.0:
                    return False
                self._settling.wait(left)
        return True

    @property
    def closed(self) -> bool:
        """Whether the writer should end."""
        return self._closed

    def close(self) -> None:
        """Wake the writer for the last time."""
        self._closed = True
        self._wake.set()
