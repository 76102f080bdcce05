"""What each thread of a service is doing: tells one that died or hangs from one that works or waits for work."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

# as long as the planner waits for an answer of a service that lives: planning.answer_deadline_s
JOB_S = 600.0
# a stop, an abort, the lease: nothing of them takes time
NOW_S = 60.0
# a sample is taken, not worked at
SAMPLE_S = 60.0

_mine = threading.local()


class Duty:
    """The account of one thread: `begin` and `end` around each job, on that thread. `longest_s` is for one job, wall
    time; what a job waits for of others, with a deadline of its own, is not counted (`waiting`)."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._thread: threading.Thread | None = None
        # (since when, until when, longest_s) of the job under way, replaced as a whole by the thread itself
        self._job: tuple[float, float, float] | None = None
        self.closed = False

    def of(self, thread: threading.Thread) -> None:
        """Whose account it is."""
        self._thread = thread

    def here(self) -> None:
        """It is that of the thread which calls this, once, before its first job."""
        _mine.duty = self

    def begin(self, longest_s: float) -> None:
        """A job begins."""
        now = time.monotonic()
        self._job = now, now + longest_s, longest_s

    def end(self) -> None:
        """It has ended."""
        self._job = None

    def allow(self, more_s: float) -> None:
        """From now on it may take so long, and then as long as a job may."""
        if self._job is not None:
            since, _, longest_s = self._job
            self._job = since, time.monotonic() + more_s + longest_s, longest_s

    def trouble(self, now: float) -> str:
        """What is wrong with the thread at `now` (time.monotonic()); empty where nothing is."""
        if self.closed or self._thread is None:
            return ""
        if not self._thread.is_alive():
            return f"{self.name} has died"
        job = self._job
        if job is not None and now > job[1]:
            return f"{self.name} hangs: at one job for {now - job[0]:.0f} s, allowed are {job[2]:g} s"
        return ""


@contextlib.contextmanager
def waiting(deadline_s: float) -> Iterator[None]:
    """Around a wait that ends by itself at its deadline: it does not count as hanging."""
    duty: Duty | None = getattr(_mine, "duty", None)
    if duty is None:
        yield
        return
    duty.allow(deadline_s)
    try:
        yield
    finally:
        duty.allow(0.0)
