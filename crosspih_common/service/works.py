"""Whether a service works, told from its working threads: the launcher's watchdog is fed for them, not for the status.

A thread that carries out commands and has died, or has been at one job for longer than a job may take, leaves a service
that shows its status every second and does nothing. Such a service does not feed the watchdog any more, says which
thread it is, and ends, so that the launcher starts it again; one that cannot even end is ended hard.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterable

from crosspih_common.bus.duty import Duty
from crosspih_common.service import notify

END_S = 5.0  # for closing what was opened, beside a thread that hangs


class Works:
    """`duties` tells the bus's threads, and `watch` adds what a service has of its own."""

    def __init__(self, duties: Callable[[], Iterable[Duty]]) -> None:
        self._duties = duties
        self._watched: list[tuple[str, Callable[[], bool]]] = []

    def watch(self, name: str, alive: Callable[[], bool]) -> None:
        """A thread of the service's own; `alive` says whether it still runs."""
        self._watched.append((name, alive))

    def trouble(self) -> str:
        """What does not work; empty when all does."""
        now = time.monotonic()
        said = [duty.trouble(now) for duty in self._duties()]
        said += [f"{name} has died" for name, alive in self._watched if not alive()]
        return "; ".join(filter(None, said))

    def feed(self) -> str:
        """Feed the watchdog, or say why not."""
        trouble = self.trouble()
        if not trouble:
            notify.watchdog()
        return trouble


def end_hard_after(seconds: float = END_S) -> None:
    """End this process with status 1 then, wherever its threads are: it is to be started again."""

    def end() -> None:
        print("what hangs does not let the service end: it is ended hard", file=sys.stderr, flush=True)
        os._exit(1)

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
