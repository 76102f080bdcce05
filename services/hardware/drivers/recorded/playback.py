"""The recording's time, and where the arm was in it: what the devices that are played share."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.recorded.film import FIELD, JointTrack
from services.hardware.protocols import JointReading

GAP_S = 0.1  # joint states further apart than this are not joined by a way: the loop sees that cycles are missing
_SHARE = 0.02  # of a period that a recorded step may be off a whole number of them
_JUMP = 2.0  # times the speed limit: a reset of a simulated cell, which is no way either


class Playback:
    """Steps from state to state, `period_s` at a time, until the recording ends or the arm is told to leave it.

    After that the arm stands, and time goes on without samples of the sensor. A recorded stamp has the recorded state
    bit for bit; in between, where the period is shorter than the recording's, positions are those of the cubic through
    both states with their speeds (Hermite). Times are the recorded cell's, ns.
    """

    def __init__(
        self,
        track: JointTrack,
        from_s: float,
        period_s: float | None,
        tolerance_rad: float,
        speed_limit_rad_s: Array,
        pace: Callable[[int], None],
    ) -> None:
        self.period_ns = track.period_ns if period_s is None else round(period_s * 1e9)
        steps = track.period_ns / self.period_ns
        if steps < 1.0 - _SHARE or abs(steps - round(steps)) > _SHARE * steps:
            raise ConfigError(
                f"hardware.recorded.period_s: {period_s} s does not divide the recording's own period of "
                f"{track.period_ns * 1e-9:g} s; leave it out, or give a whole part of it"
            )
        stamps, positions, speeds = track.stamps_ns, track.positions_rad, track.speeds_rad_s
        if track.start_ns < stamps[0]:
            stamps = np.concatenate([[track.start_ns], stamps])
            positions = np.concatenate([positions[:1], positions])
            speeds = np.concatenate([np.zeros_like(speeds[:1]), speeds])
        first = int(np.searchsorted(stamps, track.start_ns + round(from_s * 1e9)))
        if first >= len(stamps):
            raise ConfigError(
                f"hardware.recorded.from_s: {from_s:g} s is after the end: {FIELD} is "
                f"{(stamps[-1] - track.start_ns) * 1e-9:.3f} s long"
            )
        self._stamps_ns, self._positions, self._speeds = stamps[first:], positions[first:], speeds[first:]
        self._tolerance_rad, self._fastest_rad_s, self._pace = tolerance_rad, _JUMP * speed_limit_rad_s, pace
        self._began_ns = track.start_ns
        self._knot, self._part, self._parts = 0, 0, self._parts_after(0)  # of the state that comes next
        self._here = self._state()
        self._told = self._positions[0]
        self._stands, self._plays = "", True
        self._changed = threading.Condition()
        self.now_ns = int(self._stamps_ns[0])
        self.interpolated = steps > 1.0 + _SHARE
        self.farthest_rad = 0.0

    @property
    def plays(self) -> bool:
        """Whether the last cycle was one of the recording."""
        return self._plays

    @property
    def stands(self) -> str:
        """Why the arm stands and nothing is played any more; empty while it is."""
        return self._stands

    def next_state(self) -> JointReading:
        """The next cycle: recorded, in between, or where the arm stands."""
        if self._stands:
            self._plays = False
            self._go_to(self.now_ns + self.period_ns)
            return JointReading(self.now_ns, self._here.positions_rad, np.zeros_like(self._here.positions_rad))
        state = self._here = self._state()
        if self._knot == len(self._stamps_ns) - 1:
            self.halt(f"the recording ended at {self.since_s(state.stamp_ns):.3f} s")
        elif self._part + 1 < self._parts:
            self._part += 1
        else:
            self._knot, self._part, self._parts = self._knot + 1, 0, self._parts_after(self._knot + 1)
        self._go_to(state.stamp_ns)
        return state

    def tell(self, positions_rad: Array) -> None:
        """Where the arm is to be in the next cycle (n,): nothing, or where it was then.

        A place that is told again is holding still; the arm may have gone on without whoever says it. Raises
        CommandRefused not_recorded when the arm was elsewhere by more than the tolerance; it then stands.
        """
        if np.array_equal(positions_rad, self._told):
            return
        then = self._here if self._stands else self._state()
        off = np.abs(positions_rad - then.positions_rad)
        joint = int(np.argmax(np.where(np.isfinite(off), off, np.inf)))
        if off[joint] <= self._tolerance_rad:
            self.farthest_rad = max(self.farthest_rad, float(off[joint]))
            self._told = np.array(positions_rad)
            return
        self.halt(
            f"at {self.since_s(then.stamp_ns):.3f} s joint {joint + 1} was at {then.positions_rad[joint]:.4f} rad "
            f"and is told to go to {positions_rad[joint]:.4f}, {off[joint]:.2g} off where {self._tolerance_rad:g} "
            "are allowed"
        )
        raise CommandRefused(
            "not_recorded",
            f"a recording cannot be steered: {self._stands}; the arm stands. Start the cell again to play it anew, and "
            "give it the motions that were recorded, when they were",
        )

    def halt(self, why: str) -> None:
        """The arm stands from now on. Any thread may call."""
        with self._changed:
            self._stands = self._stands or why
            self._changed.notify_all()

    def wait_until(self, stamp_ns: int, deadline_s: float) -> bool:
        """Until that has come, in real time; whether it has."""
        with self._changed:
            return self._changed.wait_for(lambda: self.now_ns >= stamp_ns or bool(self._stands), deadline_s) and (
                self.now_ns >= stamp_ns
            )

    def since_s(self, stamp_ns: int) -> float:
        """A time of the cell's clock as the recording counts it, s."""
        return (stamp_ns - self._began_ns) * 1e-9

    def _go_to(self, stamp_ns: int) -> None:
        with self._changed:
            self.now_ns = stamp_ns
            self._changed.notify_all()
        self._pace(stamp_ns)

    def _parts_after(self, knot: int) -> int:
        """How many cycles lead from a state to the next."""
        if knot + 1 >= len(self._stamps_ns):
            return 1
        step_ns = int(self._stamps_ns[knot + 1] - self._stamps_ns[knot])
        way = np.abs(self._positions[knot + 1] - self._positions[knot])
        if step_ns > GAP_S * 1e9 or np.any(way > self._fastest_rad_s * step_ns * 1e-9):
            return 1
        return max(1, round(step_ns / self.period_ns))

    def _state(self) -> JointReading:
        """What the next cycle reads."""
        knot, part = self._knot, self._part
        start_ns = int(self._stamps_ns[knot])
        if part == 0:
            return JointReading(start_ns, self._positions[knot], self._speeds[knot])
        step_ns = int(self._stamps_ns[knot + 1]) - start_ns
        share, step_s = part / self._parts, step_ns * 1e-9
        at, to = self._positions[knot], self._positions[knot + 1]
        fast, then = self._speeds[knot] * step_s, self._speeds[knot + 1] * step_s
        return JointReading(start_ns + round(step_ns * share), *_hermite(share, at, to, fast, then, step_s))


def _hermite(share: float, at: Array, to: Array, fast: Array, then: Array, step_s: float) -> tuple[Array, Array]:
    """Position and speed on the cubic that leaves `at` by `fast` and reaches `to` by `then` (ways of a whole step)."""
    s, way = share, to - at
    position = at + s * fast + s * s * (3.0 * way - 2.0 * fast - then) + s**3 * (fast + then - 2.0 * way)
    speed = (fast + 2.0 * s * (3.0 * way - 2.0 * fast - then) + 3.0 * s * s * (fast + then - 2.0 * way)) / step_s
    return position, speed
