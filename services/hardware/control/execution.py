"""Runs a motion cycle by cycle, under caps, for a holder who lives, as long as loop and sensor keep up.

Whatever ends a motion early, a stop command is heard in each cycle that follows.
"""

from __future__ import annotations

import threading
from collections.abc import Generator

import numpy as np

from crosspih_common.messages import StopReason
from services.hardware.control.backing_off import LOOK_S, back_off
from services.hardware.control.config import LimitsConfig
from services.hardware.control.cycle import CycleReading, Reference
from services.hardware.control.effort import EffortMeter
from services.hardware.control.holder import Holder
from services.hardware.control.limits import TouchingLimits
from services.hardware.control.motions import Motion, MotionEnding, Steps, brake
from services.hardware.control.runner import Runner

SMALL_LOAD = (5.0, 0.5)  # N, Nm
WORSE_SHARE = 0.25  # of the caps


class Execution:
    """One motion at a time."""

    def __init__(self, runner: Runner, config: LimitsConfig, holder: Holder, effort: EffortMeter) -> None:
        self._runner, self._config, self._holder, self._effort = runner, config, holder, effort
        self._lock = threading.Lock()
        self._accepted = 0
        self._stop_wanted = False
        self._missed_before = 0
        self.peak_force_n = self.peak_moment_nm = 0.0

    # -------------------------------------------------------------------------------------------------------- stops

    def accept(self) -> None:
        """A motion was accepted: from now until `done` a stop ends it, before it begins too."""
        with self._lock:
            self._accepted += 1

    def done(self) -> None:
        """An accepted motion has ended, or did not come to begin."""
        with self._lock:
            self._accepted = max(0, self._accepted - 1)
            if not self._accepted:
                self._stop_wanted = False

    def stop(self) -> bool:
        """End what moves or is about to, at the next cycle; whether there was anything."""
        with self._lock:
            self._stop_wanted = self._accepted > 0
            return self._stop_wanted

    # -------------------------------------------------------------------------------------------------------- caps

    def restart(self) -> None:
        """A new motion: nothing was felt yet."""
        self.peak_force_n = self.peak_moment_nm = 0.0
        self._missed_before = self._runner.missed_cycles
        self._effort.restart()

    def _felt(self, reading: CycleReading) -> None:
        if reading.force_n > self.peak_force_n:
            self.peak_force_n = reading.force_n
        if reading.moment_nm > self.peak_moment_nm:
            self.peak_moment_nm = reading.moment_nm

    def over_caps(self, reading: CycleReading, adds_n: float = 0.0) -> MotionEnding | None:
        """What ends a motion that feels this, and whose speed will still add a force."""
        self._felt(reading)
        cap_n, cap_nm = self._config.force_cap_n, self._config.moment_cap_nm
        # written so that a force that is not a number trips it too
        if not reading.force_n <= cap_n - min(adds_n, 0.5 * cap_n):
            ahead = f", {adds_n:.1f} N more to come before it stands," if adds_n >= 0.5 else ""
            return MotionEnding(
                StopReason.FORCE_CAP, f"|F| {reading.force_n:.1f} N{ahead} passed the cap of {cap_n:g} N: backed off"
            )
        if not reading.moment_nm <= cap_nm:
            return MotionEnding(
                StopReason.MOMENT_CAP, f"|M| {reading.moment_nm:.2f} Nm passed {cap_nm:g} Nm: backed off"
            )
        return None

    def hold_still(self, duration_s: float) -> None:
        """Hold still for a time; the caps hold here too."""
        for _ in range(max(1, round(duration_s / self._runner.period_s))):
            if self.over_caps(self._runner.advance(self._runner.still())) is not None:
                self.brake()
                self.back_off()

    def brake(self) -> None:
        """To rest."""
        self._go(brake(self._runner, self._runner.model.limits.acceleration_rad_s2), heed_stop=False)

    def back_off(self) -> None:
        """Out of what presses, along the way it came; a stop command ends that too."""
        worse = (WORSE_SHARE * self._config.force_cap_n, WORSE_SHARE * self._config.moment_cap_nm)
        if not self._go(back_off(self._runner, SMALL_LOAD, worse), heed_stop=True):
            self.brake()

    def _go(self, steps: Generator[Reference, CycleReading, None], heed_stop: bool) -> bool:
        """Whether it came to its end."""
        try:
            reference = next(steps)
            while True:
                if heed_stop and self._stop_wanted:
                    return False
                reading = self._runner.advance(reference)
                self._effort.add(self._runner.joints_rad, reading.force_n)
                self._felt(reading)
                reference = steps.send(reading)
        except StopIteration:
            return True

    # ---------------------------------------------------------------------------------------------------------- run

    def begun(self, motion: Motion) -> tuple[Steps, Reference]:
        """A motion with its first reference, which may have taken a while to reckon; it has not moved yet."""
        steps = motion.steps(self._runner)
        return steps, next(steps)

    def run(self, steps: Steps, reference: Reference, limits: TouchingLimits) -> MotionEnding:
        """What has begun, until it or something else ends it; the arm then stands."""
        runner = self._runner
        runner.tare()
        self._holder.begin(runner.now_ns)
        while True:
            if self._stop_wanted:
                self.brake()
                return MotionEnding(StopReason.STOPPED, "stopped by command")
            if self._holder.lost(runner.now_ns):
                return self._without_holder()
            reading = runner.advance(reference)
            self._effort.add(runner.joints_rad, reading.force_n)
            ending = self.over_caps(reading, limits.adds_n(reference.tip_speed_m_s) if reference.tip_speed_m_s else 0.0)
            if ending is not None:
                self.brake()
                self.back_off()
                return ending
            ending = self._cannot_go_on()
            if ending is not None:
                self.brake()
                return ending
            try:
                reference = steps.send(reading)
            except StopIteration as end:
                ending = end.value
                assert isinstance(ending, MotionEnding)
                return ending

    def _without_holder(self) -> MotionEnding:
        runner = self._runner
        said = f"no beat of its holder for {self._holder.timeout_s:g} s: stopped"
        self.brake()
        force_n, moment_nm = self._felt_at_rest()
        if force_n > SMALL_LOAD[0] or moment_nm > SMALL_LOAD[1]:
            said += f", and went back the way it came, out of {force_n:.1f} N"
            self.back_off()
        self._holder.drop(runner.now_ns)
        return MotionEnding(StopReason.HOLDER_LOST, said)

    def _felt_at_rest(self) -> tuple[float, float]:
        """|F|, N, and |M|, Nm: what is felt right after braking is inertia, not contact."""
        count = max(3, round(LOOK_S / self._runner.period_s))
        felt = []
        for _ in range(count):
            reading = self._runner.advance(self._runner.still())
            self._felt(reading)
            felt.append(reading.contact)
        mean = np.mean(felt[-max(1, count // 3) :], axis=0)
        return float(np.linalg.norm(mean[:3])), float(np.linalg.norm(mean[3:]))

    def _cannot_go_on(self) -> MotionEnding | None:
        runner, config = self._runner, self._config
        if runner.sensor_silent_s > config.sensor_timeout_s:
            return MotionEnding(
                StopReason.SENSOR_LOST,
                f"no sample of the force/torque sensor for {runner.sensor_silent_s:.3f} s: stopped",
            )
        missed = runner.missed_cycles - self._missed_before
        if missed > config.missed_cycles:
            return MotionEnding(
                StopReason.LATE_CYCLES,
                f"the loop missed {missed} cycles of {runner.period_s * 1e3:g} ms, {config.missed_cycles} are allowed: "
                "stopped; give it a core of its own, or a longer period",
            )
        return None
