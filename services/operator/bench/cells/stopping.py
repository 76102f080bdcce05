"""However a bench is told to end, what it started ends with it: workers, their stacks, what keeps cores busy."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def stopped_in_order() -> Iterator[None]:
    """SIGINT (Ctrl-C), SIGTERM and SIGHUP alike raise KeyboardInterrupt, once: what they end closes its cells then, and
    more of them only say that this takes some seconds. One that is ignored, as by `nohup`, still is. Main thread only.
    """
    told: list[int] = []

    def on_signal(number: int, frame: FrameType | None) -> None:
        told.append(number)
        if len(told) == 1:
            raise KeyboardInterrupt
        # not by print: the signal may have come in the middle of one
        os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, b"stopping what was started, some seconds\n")

    before: dict[signal.Signals, Any] = {number: signal.getsignal(number) for number in ENDINGS}
    taken = [number for number, handler in before.items() if handler is not signal.SIG_IGN]
    for number in taken:
        signal.signal(number, on_signal)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, before[number])


def end_with_parent() -> None:
    """In a process that `multiprocessing` started: from now on SIGTERM reaches it when its parent is gone, however that
    ended. What it was at ends as the process's own handler of SIGTERM says. Ctrl-C and a terminal that closes reach the
    whole group: the parent decides when this one ends."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="parent", daemon=True).start()
