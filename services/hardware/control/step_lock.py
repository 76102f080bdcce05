"""Who may step the cell: commands before the idle clock, one at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager


class StepLock:
    """A lock that the idle loop cannot keep from those who want it: Python's own are not fair."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._claims = 0
        self._unclaimed = threading.Condition()

    @contextmanager
    def taken(self) -> Iterator[None]:
        """The turn of a command; waits for a step that is under way."""
        with self._unclaimed:
            self._claims += 1
        try:
            with self._lock:
                yield
        finally:
            with self._unclaimed:
                self._claims -= 1
                self._unclaimed.notify_all()

    @contextmanager
    def idle(self) -> Iterator[None]:
        """The turn of the idle loop; waits until nobody else wants it."""
        with self._unclaimed:
            self._unclaimed.wait_for(lambda: self._claims == 0)
        with self._lock:
            yield
