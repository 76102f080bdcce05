"""Whether a service works, judged by its working threads: they feed the launcher's watchdog, not the status thread.

If a thread that carries out commands has died, or hangs in one job, the service may still publish its status every
second but does no work. It then stops feeding the watchdog, names the thread, and ends, so that the launcher starts it
again. A service that cannot even end is killed.
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
    """`duties` returns the accounts of the bus's threads; `watch` adds a service's own threads."""

    def __init__(self, duties: Callable[[], Iterable[Duty]]) -> None:
        self._duties = duties
        self._watched: list[tuple[str, Callable[[], bool]]] = []

    def watch(self, name: str, alive: Callable[[], bool]) -> None:
        """Add a thread of the service; `alive` says whether it still runs."""
        self._watched.append((name, alive))

    def trouble(self) -> str:
        """A description of what does not work; empty when all works."""
        now = time.monotonic()
        said = [duty.trouble(now) for duty in self._duties()]
        said += [f"{name} has died" for name, alive in self._watched if not alive()]
        return "; ".join(filter(None, said))

    def feed(self) -> str:
        """Feed the watchdog if all works; else return the reason."""
        trouble = self.trouble()
        if not trouble:
            notify.watchdog()
        return trouble


def end_hard_after(seconds: float = END_S) -> None:
    """Kill this process with status 1 after a delay, whatever its threads do, so that it is started again."""

    def end() -> None:
        print("what hangs does not let the service end: it is ended hard", file=sys.stderr, flush=True)
        os._exit(1)

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
