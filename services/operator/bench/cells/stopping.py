"""However a bench is stopped, everything that it started ends with it: workers, their stacks, and load processes."""

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
    """SIGINT (Ctrl-C), SIGTERM and SIGHUP alike raise KeyboardInterrupt, once; the interrupted code then closes its
    cells. Further signals only print that this takes some seconds. A signal that is ignored, as by `nohup`, stays
    ignored. Main thread only.
    """
    told: list[int] = []

    def on_signal(number: int, frame: FrameType | None) -> None:
        told.append(number)
        if len(told) == 1:
            raise KeyboardInterrupt
        # without print: the signal may have come in the middle of one
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
    """For a process that `multiprocessing` started: from now on it gets SIGTERM when its parent is gone, however that
    ended. Its own handler of SIGTERM decides how its work ends. Ctrl-C and a closing terminal reach the whole group,
    and are ignored here: the parent decides when this process ends.
    """
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="parent", daemon=True).start()
