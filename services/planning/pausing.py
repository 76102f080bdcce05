"""A pause of the running assembly: the arm finishes the motion under way, and waits for the resume command."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

LOOK_S = 0.2  # period at which a pause checks whether the assembly has ended


class Pause:
    """Whether the next motion waits. One thread sets it, another one waits for it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._paused = False

    def ask(self, paused: bool) -> bool:
        """Pause, or go on; whether that changes anything."""
        with self._changed:
            changed, self._paused = self._paused != paused, paused
            self._changed.notify_all()
            return changed

    def wait_to_go_on(self, ended: Callable[[], bool], tell: Callable[[str, str], None]) -> float:
        """Return at once if not paused, else after the resume or when it has `ended`. Returns the time waited, s."""
        with self._changed:
            if not self._paused:
                return 0.0
        began = time.monotonic()
        tell("paused", "paused: the arm holds where it is until `crosspih resume`, or `crosspih stop`")
        with self._changed:
            while self._paused and not ended():
                self._changed.wait(LOOK_S)
        if not ended():
            tell("resumed", f"goes on after {time.monotonic() - began:.1f} s")
        return time.monotonic() - began
