"""The simulated arm: checks commands, runs motions under the caps, and says what was really done."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import (
    AdmittanceMove,
    Dwell,
    FollowTrajectory,
    GuardedMove,
    GuardedMoveOutcome,
    JointState,
    MotionOutcome,
    MoveLinear,
    SetPayload,
    StopReason,
)
from crosspih_common.messages.base import PoseData, floats
from services.hardware.control.admittance import Admittance
from services.hardware.control.effort import Effort
from services.hardware.control.guarded import OVERSHOOT_M, Guarded
from services.hardware.control.motions import Ending, Follow, Hold, Linear, Motion, back_off, brake
from services.hardware.control.paths import (
    JointTrajectory,
    between,
    line,
    refuse_not_finite,
    unit_direction,
)
from services.hardware.control.payload import Payload
from services.hardware.control.search_path import SearchPath
from services.hardware.control.servo import LAST_SAMPLES, Reading, Servo
from services.hardware.control.turn import Turn
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.pybullet.engine import STEP_S

SMALL_LOAD = (5.0, 0.5)  # N, Nm
WORSE_SHARE = 0.25  # of the caps
_LINEAR_M_S2 = 2.0
_LINEAR_RAD_S2 = 10.0


class SimulatedArm:
    """Implements the Arm protocol. Commands come from any thread, one at a time."""

    def __init__(self, workcell: Workcell, config: SimulatedConfig, servo: Servo, turn: Turn) -> None:
        self._arm = workcell.arm()
        self._pose_flange_peg = workcell.pose_flange_peg()
        self._config = config
        self._servo = servo
        self._turn = turn  # whoever steps the cell has it
        self._commanded = threading.Lock()
        self._stop_lock = threading.Lock()
        self._moving = False
        self._stop_wanted = False
        self._peak_force_n = 0.0
        self._peak_moment_nm = 0.0
        tip_m = [0.0, 0.0, workcell.peg.shape().tip_m]
        self._effort = Effort(self._arm, self._pose_flange_peg.apply(tip_m), STEP_S)

    def joint_state(self) -> JointState:
        """The encoders now: the motor side."""
        return self._servo.joint_state()

    def on_joint_state(self, listener: Callable[[JointState], object]) -> None:
        """250 Hz of cell time."""
        self._servo.on_joint_state(listener)

    def follow(self, command: FollowTrajectory) -> MotionOutcome:
        """Raises CommandRefused: wrong_start, joint_limit, speed_limit, acceleration_limit, knots, not_finite."""
        with self._command():
            trajectory = JointTrajectory(self._arm, command.knots, self._servo.joints_rad)
            return self._done(self._run(Follow(trajectory)), None)

    def move_linear(self, command: MoveLinear) -> MotionOutcome:
        """Raises CommandRefused: unreachable, joint_limit, not_finite. Joint limits may make it slower than asked."""
        refuse_not_finite("pose_base_peg", [*command.pose_base_peg.position_m, *command.pose_base_peg.quaternion_xyzw])
        if float(np.linalg.norm(command.pose_base_peg.quaternion_xyzw)) < 1e-6:
            raise CommandRefused("not_finite", "pose_base_peg.quaternion_xyzw is zero, want a rotation")
        with self._command():
            start, goal = self._servo.forward(self._servo.joints_rad), command.pose_base_peg.pose()
            path = between(self._arm, self._pose_flange_peg, start, goal, self._servo.joints_rad)
            distance, angle = start.distance_to_m(goal), start.angle_to_rad(goal)
            duration_s = max(
                1.875 * distance / command.speed_m_s,
                1.875 * angle / command.rotational_speed_rad_s,
                float(np.sqrt(5.7736 * distance / _LINEAR_M_S2)),
                float(np.sqrt(5.7736 * angle / _LINEAR_RAD_S2)),
                0.004,
            )
            return self._done(self._run(Linear(path, path.shortest_s(duration_s))), None)

    def guarded_move(self, command: GuardedMove) -> GuardedMoveOutcome:
        """`travel_m` is how far it went before it retreated. Raises as `move_linear`, and speed_limit."""
        direction = unit_direction("direction_base", command.direction_base)
        with self._command():
            servo = self._servo
            start = servo.forward(servo.joints_rad)
            creep_m = command.creep_speed_m_s * max(command.observe_s, command.observe_samples * 1e-3)
            beyond_m = creep_m + command.speed_m_s**2 / 10.0 + OVERSHOOT_M
            path = line(
                self._arm, self._pose_flange_peg, start, direction, command.travel_limit_m + beyond_m, servo.joints_rad
            )
            path.check_speed(max(command.speed_m_s, 0.05))
            motion = Guarded(path, command)
            self._feel_nothing()
            outcome = self._done(self._run(motion), motion.travel_m)
            found: dict[str, object] = {}
            if motion.free_raw is not None:
                found["wrench_free_raw"] = floats(motion.free_raw)
            if motion.onset_m is not None:
                found["travel_first_contact_m"] = motion.onset_m
                found["pose_base_peg_first_contact"] = PoseData.of(path.pose_at(motion.onset_m))
            if (
                motion.observed_raw is not None
                and motion.observed_travel_m is not None
                and motion.observed_joints_rad is not None
            ):
                mean, sd = _mean(motion.observed_raw)
                found["pose_base_peg_observed"] = PoseData.of(path.pose_at(motion.observed_travel_m))
                found["joints_observed_rad"] = floats(motion.observed_joints_rad)
                found["wrench_observed_raw"], found["wrench_observed_sd"] = floats(mean), floats(sd)
            return GuardedMoveOutcome.model_validate(
                {**outcome.model_dump(), "direction_base": floats(direction), **found}
            )

    def admittance_move(self, command: AdmittanceMove) -> MotionOutcome:
        """`travel_m` is along the direction. Raises as `guarded_move`, and path."""
        direction = unit_direction("direction_base", command.direction_base)
        refuse_not_finite("centre_peg_m", command.centre_peg_m)
        with self._command():
            servo = self._servo
            start = servo.forward(servo.joints_rad)
            path = line(self._arm, self._pose_flange_peg, start, direction, command.travel_m, servo.joints_rad)
            search = SearchPath(command.path, start.rotation, direction)
            path.check_speed(command.speed_m_s + command.lateral_speed_limit_m_s + search.fastest_m_s)
            motion = Admittance(self._arm, self._pose_flange_peg, start, direction, command, search)
            self._feel_nothing()
            return self._done(self._run(motion), motion.travel_m)

    def dwell(self, command: Dwell) -> MotionOutcome:
        """The wrench is the mean of the dwell, less its first 30 ms."""
        with self._command():
            motion = Hold(command.duration_s)
            outcome = self._done(self._run(motion), 0.0)
            if len(motion.samples) < 2:
                return outcome
            mean, sd = _mean(np.array(motion.samples))
            return outcome.model_copy(update={"wrench_raw": floats(mean), "wrench_sd": floats(sd)})

    def set_payload(self, command: SetPayload) -> None:
        """Raises CommandRefused: not_finite, direction."""
        refuse_not_finite("bias", command.bias)
        refuse_not_finite("centroid_ft_m", [command.weight_n, *command.centroid_ft_m])
        unit_direction("gravity_base", command.gravity_base)
        with self._turn.taken():
            self._servo.use_payload(Payload.from_command(command))

    def stop(self) -> bool:
        """At the next step; whether anything moved."""
        with self._stop_lock:
            self._stop_wanted = self._moving
            return self._moving

    def idle_step(self) -> None:
        """One millisecond between commands."""
        with self._turn.idle():
            self.hold_still(1)

    def hold_still(self, steps: int) -> None:
        """Some milliseconds of holding still; the caps hold here too. For whoever has the turn."""
        for _ in range(steps):
            if self._over_caps(self._servo.advance(self._servo.still())) is not None:
                self._back_off()

    @contextmanager
    def exclusively(self) -> Iterator[None]:
        """No command may run beside this. Raises CommandRefused busy."""
        if not self._commanded.acquire(blocking=False):
            raise CommandRefused("busy", "another command is being carried out; wait for it or stop it")
        try:
            with self._turn.taken():
                yield
        finally:
            self._commanded.release()

    @contextmanager
    def between_motions(self) -> Iterator[None]:
        """Wait for a motion to end, and let none begin meanwhile."""
        with self._commanded, self._turn.taken():
            yield

    @contextmanager
    def _command(self) -> Iterator[None]:
        with self.exclusively():
            with self._stop_lock:
                self._moving, self._stop_wanted = True, False
            self._peak_force_n = self._peak_moment_nm = 0.0
            self._effort.restart()
            self._start_ns = self._servo.now_ns
            self._start_joints = self._servo.joints_rad
            try:
                yield
            finally:
                with self._stop_lock:
                    self._moving = self._stop_wanted = False

    def _feel_nothing(self) -> None:
        """Without a known payload, moves that go by force first need something to tare by."""
        if self._servo.payload is None and len(self._servo.last_raw) < LAST_SAMPLES:
            self.hold_still(LAST_SAMPLES)
            self._peak_force_n = self._peak_moment_nm = 0.0

    def _over_caps(self, reading: Reading) -> Ending | None:
        self._peak_force_n = max(self._peak_force_n, reading.force_n)
        self._peak_moment_nm = max(self._peak_moment_nm, reading.moment_nm)
        # written so that a force that is not a number trips it too
        if not reading.force_n <= self._config.force_cap_n:
            return Ending(
                StopReason.FORCE_CAP, f"|F| {reading.force_n:.1f} N passed {self._config.force_cap_n:g} N: backed off"
            )
        if not reading.moment_nm <= self._config.moment_cap_nm:
            return Ending(
                StopReason.MOMENT_CAP,
                f"|M| {reading.moment_nm:.2f} Nm passed {self._config.moment_cap_nm:g} Nm: backed off",
            )
        return None

    def _back_off(self) -> None:
        servo = self._servo
        worse = (WORSE_SHARE * self._config.force_cap_n, WORSE_SHARE * self._config.moment_cap_nm)
        for steps in (
            brake(servo, self._arm.limits.acceleration_rad_s2),
            back_off(servo, SMALL_LOAD, worse),
        ):
            try:
                reference = next(steps)
                while True:
                    reading = servo.advance(reference)
                    self._effort.add(servo.joints_rad, reading.force_n)
                    self._peak_force_n = max(self._peak_force_n, reading.force_n)
                    self._peak_moment_nm = max(self._peak_moment_nm, reading.moment_nm)
                    reference = steps.send(reading)
            except StopIteration:
                pass

    def _run(self, motion: Motion) -> Ending:
        servo = self._servo
        servo.tare()
        steps = motion.steps(servo)
        reference = next(steps)
        while True:
            if self._stop_wanted:
                for slower in brake(servo, self._arm.limits.acceleration_rad_s2):
                    servo.advance(slower)
                return Ending(StopReason.STOPPED, "stopped by command")
            reading = servo.advance(reference)
            self._effort.add(servo.joints_rad, reading.force_n)
            ending = self._over_caps(reading)
            if ending is not None:
                self._back_off()
                return ending
            try:
                reference = steps.send(reading)
            except StopIteration as end:
                ending = end.value
                assert isinstance(ending, Ending)
                return ending

    def _done(self, ending: Ending, travel_m: float | None) -> MotionOutcome:
        servo = self._servo
        pose = servo.forward(servo.joints_rad)
        servo.pose_base_peg = pose
        if travel_m is None:
            travel_m = pose.distance_to_m(servo.forward(self._start_joints))
        servo.speeds_rad_s = np.zeros(6)
        mean, sd = _mean(np.array(servo.last_raw)) if servo.last_raw else (np.zeros(6), np.zeros(6))
        return MotionOutcome(
            stamp_ns=servo.now_ns,
            stop_reason=ending.reason,
            detail=ending.detail,
            start_stamp_ns=self._start_ns,
            duration_s=(servo.now_ns - self._start_ns) * 1e-9,
            travel_m=travel_m,
            joints_rad=floats(servo.joints_rad),
            pose_base_peg=PoseData.of(pose),
            wrench_raw=floats(mean),
            wrench_sd=floats(sd),
            peak_force_n=self._peak_force_n,
            peak_moment_nm=self._peak_moment_nm,
            **dataclasses.asdict(self._effort.figures()),
        )


def _mean(samples: Array) -> tuple[Array, Array]:
    """Mean (6,) and standard deviation of the mean (6,) of samples (n, 6)."""
    count = len(samples)
    sd = samples.std(axis=0, ddof=1) / np.sqrt(count) if count > 1 else np.zeros(samples.shape[1])
    return np.asarray(samples.mean(axis=0)), np.asarray(sd)
