"""Who holds the arm: one at a time, and only as long as its beats come."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable

from crosspih_common.errors import CommandRefused
from crosspih_common.messages import LeaseState

BEATS_A_TIMEOUT = 5
# Between two beats a cell that is not in real time goes on for one time-out at the most, and then stands still: with so
# many it may be twenty times as fast as the wall's clock. With half as many the beats held it back.
BEATS_A_FAST_TIMEOUT = 20
CUT_OFF_S = 0.5  # of the arm's own loop, without any beat at all
WINDOW_S = 0.05  # over which silence is counted: longer than a loop sleeps between two heaps of cycles
WAIT_S = 3.0  # for a beat, of a cell whose time stands still meanwhile


class Holder:
    """The lease. The arm's loop asks `lost` in every cycle of a motion.

    In real time the arm beats beside its holder, and hears itself the same way. The holder is silent only for as long
    as the arm's own beats come and its do not: on a stalled machine both wait in the same queue. Where not even the
    arm's own come for `CUT_OFF_S` it is cut off, and nobody holds it. A simulated cell that runs faster than the wall's
    clock stands still until the holder's next beat has come.
    """

    def __init__(self, timeout_s: float, realtime: bool) -> None:
        self.timeout_s = timeout_s
        self._realtime = realtime
        self._changed = threading.Condition()
        self._lease = ""
        self._state = LeaseState(since_ns=0)
        self._beats = 0
        self._beat_at_s = 0.0  # wall clock
        self._seen_beats = -1
        self._seen_ns = 0
        self._silent_s = 0.0  # in the windows that are over
        self._window_at_s = 0.0
        self._window_ns = 0
        self._own_beats = 0  # since the holder's last one
        self._own_at_s = 0.0
        self.on_change: Callable[[LeaseState], object] = lambda state: None

    @property
    def beat_s(self) -> float:
        """How often a holder is to beat, wall time; oftener where the cell's time may run faster than the wall's."""
        return self.timeout_s / (BEATS_A_TIMEOUT if self._realtime else BEATS_A_FAST_TIMEOUT)

    def state(self) -> LeaseState:
        """Who holds the arm."""
        with self._changed:
            return self._state

    def take(self, holder: str, purpose: str, now_ns: int) -> str:
        """A lease for this holder. Raises CommandRefused held while another one's beats come."""
        with self._changed:
            if self._lease and not self._expired():
                raise CommandRefused("held", f"the arm is held by {self._who()}; wait until it lets go of it")
            self._lease = secrets.token_hex(8)
            self._state = LeaseState(holder=holder, purpose=purpose, since_ns=max(now_ns, 0))
            self._beats += 1
            self._beat_at_s = time.monotonic()
            lease, state = self._lease, self._state
        self.on_change(state)
        return lease

    def give(self, lease: str, now_ns: int) -> bool:
        """Let go; whether that lease was the present one."""
        with self._changed:
            if not lease or lease != self._lease:
                return False
            state = self._clear(now_ns, lost=False)
        self.on_change(state)
        return True

    def beat(self, lease: str) -> None:
        """The holder lives; of any other lease nothing happens."""
        with self._changed:
            if lease and lease == self._lease:
                self._beats += 1
                self._own_beats, self._silent_s = 0, 0.0
                self._beat_at_s = time.monotonic()
                self._changed.notify_all()

    def own_beat(self) -> None:
        """The arm hears its own beat, sent every `beat_s`; those that come in a heap count as one."""
        with self._changed:
            wall_s = time.monotonic()
            if wall_s - self._own_at_s >= 0.5 * self.beat_s:
                self._own_beats += 1
                self._own_at_s, self._silent_s = wall_s, 0.0

    def require(self, lease: str) -> None:
        """Raises CommandRefused no_lease when that is not the present lease."""
        with self._changed:
            if self._lease and lease == self._lease and not self._expired():
                return
            if self._lease and lease != self._lease and not self._expired():
                raise CommandRefused(
                    "no_lease", f"the arm is held by {self._who()}; motion is its holder's alone: wait, or stop it"
                )
        raise CommandRefused(
            "no_lease", "nobody holds the arm; take the lease first (arm/lease/take) and keep it by beats"
        )

    def begin(self, now_ns: int) -> None:
        """A motion of the holder begins."""
        with self._changed:
            self._seen_beats, self._seen_ns = self._beats, now_ns
            self._silent_s, self._window_at_s = 0.0, time.monotonic()
            self._window_ns, self._own_beats = now_ns, 0

    def lost(self, now_ns: int) -> bool:
        """Once a cycle: whether the holder is gone. Never of a motion that nobody holds the lease for."""
        with self._changed:
            if not self._lease:
                return False
            wall_s = time.monotonic()
            if self._beats != self._seen_beats:
                self._seen_beats, self._seen_ns, self._silent_s = self._beats, now_ns, 0.0
                self._window_at_s, self._window_ns = wall_s, now_ns
            elif self._realtime:
                silent_s = self._count_silence(now_ns, wall_s)
                heard_us_only = self._own_beats * self.beat_s >= 0.999 * self.timeout_s
                if heard_us_only and wall_s - self._beat_at_s >= self.timeout_s:
                    return True
                if silent_s > max(CUT_OFF_S, self.timeout_s):
                    return True
            elif now_ns - self._seen_ns > 1e9 * self.timeout_s:
                beats = self._beats
                if not self._changed.wait_for(lambda: self._beats != beats or not self._lease, WAIT_S):
                    self._silent_s = self.timeout_s
                else:
                    self._seen_beats, self._seen_ns = self._beats, now_ns
            return not self._realtime and self._silent_s >= self.timeout_s

    def _count_silence(self, now_ns: int, wall_s: float) -> float:
        """How long nothing was heard, s. Of each window the shorter time counts, the loop's or the wall's.

        While the loop was held up, beats waited as it did; while it catches up, its clock runs ahead of them. In a
        single cycle the shorter one would say little: a loop may do many cycles at once and then sleep.
        """
        window_s = min(wall_s - self._window_at_s, (now_ns - self._window_ns) * 1e-9)
        if wall_s - self._window_at_s < WINDOW_S:
            return self._silent_s + window_s
        self._silent_s += window_s
        self._window_at_s, self._window_ns = wall_s, now_ns
        return self._silent_s

    def drop_expired(self, now_ns: int) -> None:
        """Between motions: let go of a holder whose beats have stayed away, and say so."""
        with self._changed:
            if not self._lease or not self._expired():
                return
            state = self._clear(now_ns, lost=True)
        self.on_change(state)

    def drop(self, now_ns: int) -> None:
        """The holder is gone: motion needs the lease to be taken anew."""
        with self._changed:
            state = self._clear(now_ns, lost=True)
        self.on_change(state)

    def _clear(self, now_ns: int, lost: bool) -> LeaseState:
        before = self._state
        self._lease = ""
        self._state = LeaseState(
            since_ns=max(now_ns, 0),
            lost_holder=before.holder if lost else "",
            lost_purpose=before.purpose if lost else "",
        )
        self._changed.notify_all()
        return self._state

    def _expired(self) -> bool:
        patience_s = self.timeout_s if self._realtime else WAIT_S
        return time.monotonic() - self._beat_at_s > max(patience_s, 10.0 * self.timeout_s)

    def _who(self) -> str:
        return f"{self._state.holder} ({self._state.purpose})" if self._state.purpose else self._state.holder
