"""Who holds the arm: one lease at a time, kept by beats."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable

from crosspih_common.errors import CommandRefused
from crosspih_common.messages import GiveLease, LeaseBeat, LeaseGiven, LeaseGranted, LeaseState, TakeLease

CHECKS = 5  # a time-out is so many checks without a beat: a check that is late does not shorten it


class LeaseDesk:
    """Grants, keeps and ends the lease. Times are wall time; safe to call from any thread.

    `on_change` hears who holds the arm, `on_lost` is called with what to say once a holder's beats are missed.
    """

    def __init__(
        self, timeout_s: float, now_ns: Callable[[], int], on_change: Callable[[LeaseState], object],
        on_lost: Callable[[str], object],
    ) -> None:  # fmt: skip
        self._timeout_s, self._now_ns, self._on_change, self._on_lost = timeout_s, now_ns, on_change, on_lost
        self._lock = threading.Lock()
        self._lease = ""
        self._state = LeaseState(since_ns=now_ns())
        self._lost = ""  # whom it was taken from, and why
        self._missed = 0
        self._closing = threading.Event()
        self._watch = threading.Thread(target=self._check, name="lease", daemon=True)
        self._watch.start()

    def take(self, request: TakeLease) -> LeaseGranted:
        """Raises CommandRefused `held`, naming the holder."""
        with self._lock:
            if self._lease:
                raise CommandRefused("held", f"the arm is held by {self._who()}; wait, or end that first")
            self._lease, self._missed = secrets.token_hex(8), 0
            self._turn(request.holder, request.purpose)
            return LeaseGranted(
                lease=self._lease, holder=request.holder, timeout_s=self._timeout_s, beat_s=self._timeout_s / CHECKS
            )

    def give(self, request: GiveLease) -> LeaseGiven:
        """Let go of it, if it is the present one."""
        with self._lock:
            held = bool(self._lease) and request.lease == self._lease
            if held:
                self._lease = self._lost = ""
                self._turn("", "")
            return LeaseGiven(was_held=held)

    def beat(self, beat: LeaseBeat) -> None:
        """The holder lives."""
        with self._lock:
            if beat.lease == self._lease:
                self._missed = 0

    def require(self, lease: str) -> None:
        """Raises CommandRefused `no_lease` unless that is the present one."""
        with self._lock:
            if self._lease and lease == self._lease:
                return
            if self._lease:
                raise CommandRefused("no_lease", f"the arm is held by {self._who()}; only the holder may move it")
            raise CommandRefused("no_lease", f"nobody holds the arm{self._lost}; take the lease first (arm/lease/take)")

    def _who(self) -> str:
        return self._state.holder + (f" ({self._state.purpose})" if self._state.purpose else "")

    def _turn(self, holder: str, purpose: str) -> None:
        self._state = LeaseState(holder=holder, purpose=purpose, since_ns=self._now_ns())
        self._on_change(self._state)

    def _check(self) -> None:
        while not self._closing.wait(self._timeout_s / CHECKS):
            with self._lock:
                self._missed += 1
                if not self._lease or self._missed <= CHECKS:
                    continue
                why = f"no beat of {self._who()} for {self._timeout_s:g} s"
                self._lease, self._lost = "", f": {why}"
                self._turn("", "")
            self._on_lost(why)

    def close(self) -> None:
        """Check no more."""
        self._closing.set()
        self._watch.join()
