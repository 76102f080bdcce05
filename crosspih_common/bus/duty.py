"""What each thread of a service is doing: distinguishes a dead or hung thread from one that works or waits."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

# the time that the planner waits for the answer of a living service: planning.answer_deadline_s
JOB_S = 600.0
# a stop, an abort, the lease: all of these are short
NOW_S = 60.0
# taking a sample is short: the work is done elsewhere
SAMPLE_S = 60.0

_mine = threading.local()


class Duty:
    """The account of one thread: `begin` and `end` around each job, on that thread. `longest_s` is the limit for one
    job in wall time; waits for other services that have a deadline of their own do not count (`waiting`)."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._thread: threading.Thread | None = None
        # (since when, until when, longest_s) of the job under way, replaced as a whole by the thread itself
        self._job: tuple[float, float, float] | None = None
        self.closed = False

    def of(self, thread: threading.Thread) -> None:
        """Set the thread that this account is for."""
        self._thread = thread

    def here(self) -> None:
        """Set the calling thread as the one of this account; called once, before its first job."""
        _mine.duty = self

    def begin(self, longest_s: float) -> None:
        """A job begins."""
        now = time.monotonic()
        self._job = now, now + longest_s, longest_s

    def end(self) -> None:
        """It has ended."""
        self._job = None

    def allow(self, more_s: float) -> None:
        """Allow the job under way this many more seconds from now; the limit of later jobs is unchanged."""
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
    """Wrap a wait that ends by itself at its deadline: it does not count as hanging."""
    duty: Duty | None = getattr(_mine, "duty", None)
    if duty is None:
        yield
        return
    duty.allow(deadline_s)
    try:
        yield
    finally:
        duty.allow(0.0)
