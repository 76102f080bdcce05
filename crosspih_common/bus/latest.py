"""The newest samples of a topic, to be read or waited for."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from crosspih_common.keys import Payload

PayloadT = TypeVar("PayloadT", bound=Payload)


class Latest(Generic[PayloadT]):
    """The newest samples of a topic, at most `depth`; older ones fall out."""

    def __init__(self, depth: int) -> None:
        self._ring: deque[PayloadT] = deque(maxlen=depth)
        self._changed = threading.Condition()

    def _push(self, value: PayloadT) -> None:
        with self._changed:
            self._ring.append(value)
            self._changed.notify_all()

    def value(self) -> PayloadT | None:
        """The newest, or None before the first."""
        with self._changed:
            return self._ring[-1] if self._ring else None

    def values(self) -> list[PayloadT]:
        """All that are kept, oldest first."""
        with self._changed:
            return list(self._ring)

    def wait_for(self, accept: Callable[[PayloadT], bool], deadline_s: float) -> PayloadT | None:
        """The newest sample for which `accept` is true, waiting up to the deadline; None if there is none by then."""
        until = time.monotonic() + deadline_s
        with self._changed:
            while True:
                for value in reversed(self._ring):
                    if accept(value):
                        return value
                left = until - time.monotonic()
                if left <= 0.0:
                    return None
                self._changed.wait(left)
