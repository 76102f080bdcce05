"""The arm's controller over thin devices: judges commands, runs motions, and says what was really done."""

from __future__ import annotations

import dataclasses
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np

from crosspih_common.collision import CollisionModel
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, DeviceLost
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
    RawWrenchBatch,
    SetPayload,
)
from crosspih_common.messages.base import PoseData, floats
from crosspih_common.wrench import IMPLAUSIBLE, Payload, judge_payload, mean_and_sd
from services.hardware.control.admittance import Admittance
from services.hardware.control.config import LimitsConfig
from services.hardware.control.effort import EffortMeter
from services.hardware.control.execution import Execution
from services.hardware.control.guarded import OVERSHOOT_M, Guarded
from services.hardware.control.holder import Holder
from services.hardware.control.limits import TouchingLimits, judged_admittance, judged_guarded, path_stretch
from services.hardware.control.motions import Along, Hold, Motion, MotionEnding
from services.hardware.control.paths import (
    JointPath,
    LineInTime,
    between,
    line,
    refuse_longer,
    refuse_not_finite,
    unit_direction,
)
from services.hardware.control.runner import LAST_S, Runner
from services.hardware.control.search_path import SearchPath
from services.hardware.control.step_lock import StepLock
from services.hardware.control.zone import ContactZone, tip_pose
from services.hardware.protocols import JointDevice, Landing, WrenchDevice

_LINEAR_M_S2 = 2.0
_LINEAR_RAD_S2 = 10.0
PATH_KNOTS = 25  # of a way that is checked against what stands around it; more are looked at in between


class ArmController:
    """The arm and the sensor in its wrist. Commands come from any thread, one at a time."""

    def __init__(
        self, workcell: Workcell, config: LimitsConfig, landing: Landing, joints: JointDevice, wrench: WrenchDevice,
        realtime: bool,
    ) -> None:  # fmt: skip
        self._arm = joints.model
        self._pose_flange_peg = workcell.pose_flange_peg()
        self._pose_flange_tip = tip_pose(workcell)
        self._stiffness_nm_rad = np.asarray(workcell.joint_stiffness_nm_rad, float)
        self._config, self._landing = config, landing
        self._joints = joints
        self._runner = Runner(joints, wrench, self._pose_flange_peg, workcell.sensor_mounting())
        self._mounting, self._payload_limits = workcell.sensor_mounting(), workcell.payload_limits()
        self._zone = ContactZone(workcell, self._arm)
        self._collisions = CollisionModel(workcell)
        self._turn = StepLock()  # whoever steps the cell has it
        self._commanded = threading.Lock()
        self.holder = Holder(config.holder_timeout_s, realtime)
        self._effort = EffortMeter(self._arm, self._pose_flange_tip.translation_m, joints.period_s)
        self._execution = Execution(self._runner, config, self.holder, self._effort)
        self._closing = threading.Event()
        self._idler: threading.Thread | None = None
        self.on_broken: Callable[[str], object] = lambda why: None  # the loop between the motions has ended by a fault
        self.broken = ""
        if realtime:
            self._idler = threading.Thread(target=self._idle, name="arm-loop", daemon=True)
            self._idler.start()

    # ------------------------------------------------------------------------------------------------------- streams

    def now_ns(self) -> int:
        """The arm's clock, which is the cell's, ns."""
        return self._runner.now_ns

    def on_tick(self, listener: Callable[[int], object]) -> None:
        """Call with the cell time about 50 times a second of cell time."""
        self._runner.on_tick(listener)

    def joint_state(self) -> JointState:
        """The encoders now: the motor side."""
        return self._runner.joint_state()

    def on_joint_state(self, listener: Callable[[JointState], object]) -> None:
        """Call with every joint state (250 Hz of cell time, or the arm's own rate where that is slower)."""
        self._runner.on_joint_state(listener)

    def on_batch(self, listener: Callable[[RawWrenchBatch], object]) -> None:
        """Call with all raw samples of the sensor, in batches of about 10 ms."""
        self._runner.on_batch(listener)

    def last_contact(self) -> Array:
        """The contact wrench (6,) on the peg, N and Nm, peg frame, as felt in the last cycle."""
        return self._runner.last_contact()

    # ------------------------------------------------------------------------------------------------------ commands

    def follow(self, command: FollowTrajectory) -> MotionOutcome:
        """Raises CommandRefused: wrong_start, joint_limit, speed_limit, acceleration_limit, knots, not_finite, size."""
        with self._command():
            refuse_longer("knots", command.knots[-1].time_s - command.knots[0].time_s, self._config.motion_s)
            trajectory = JointPath(self._arm, command.knots, self._runner.joints_rad)
            return self._along(trajectory)

    def move_linear(self, command: MoveLinear) -> MotionOutcome:
        """Raises CommandRefused: unreachable, joint_limit, not_finite, size. Joint limits may make it slower."""
        refuse_not_finite("pose_base_peg", [*command.pose_base_peg.position_m, *command.pose_base_peg.quaternion_xyzw])
        if float(np.linalg.norm(command.pose_base_peg.quaternion_xyzw)) < 1e-6:
            raise CommandRefused("not_finite", "pose_base_peg.quaternion_xyzw is zero, want a rotation")
        with self._command():
            start, goal = self._runner.forward(self._runner.joints_rad), command.pose_base_peg.pose()
            distance, angle = start.distance_to_m(goal), start.angle_to_rad(goal)
            duration_s = max(
                1.875 * distance / command.speed_m_s,
                1.875 * angle / command.rotational_speed_rad_s,
                float(np.sqrt(5.7736 * distance / _LINEAR_M_S2)),
                float(np.sqrt(5.7736 * angle / _LINEAR_RAD_S2)),
                4.0 * self._runner.period_s,
            )
            refuse_longer("speed_m_s", duration_s, self._config.motion_s)
            path = between(self._arm, self._pose_flange_peg, start, goal, self._runner.joints_rad)
            return self._along(LineInTime(path, path.shortest_s(duration_s)))

    def _along(self, path: JointPath | LineInTime) -> MotionOutcome:
        self._refuse_collision(path.positions(np.linspace(0.0, path.duration_s, PATH_KNOTS)))
        limits = self._limits()
        pace, note = self._zone.pace(
            path, limits.contact_speed_m_s(), self._config.free_braking_m_s2, self._config.clear_out_m_s
        )
        return self._carry_out(Along(path, pace), limits, [note] if note else [])

    def guarded_move(self, command: GuardedMove) -> GuardedMoveOutcome:
        """`travel_m`: how far it went before it retreated. Raises as `move_linear`, speed_limit, cap, no_payload."""
        direction = unit_direction("direction_base", command.direction_base)
        with self._command():
            runner, limits = self._runner, self._limits()
            command, notes = judged_guarded(command, limits)
            refuse_longer("speed_m_s", command.travel_limit_m / command.speed_m_s, self._config.motion_s)
            start = runner.forward(runner.joints_rad)
            creep_m = command.creep_speed_m_s * max(command.observe_s, command.average_s)
            beyond_m = creep_m + command.speed_m_s**2 / 10.0 + OVERSHOOT_M
            path = line(
                self._arm, self._pose_flange_peg, start, direction, command.travel_limit_m + beyond_m, runner.joints_rad
            )
            path.check_speed(max(command.speed_m_s, 0.05))
            self._refuse_collision(path.joints(PATH_KNOTS))
            self._require_payload()
            motion = Guarded(path, command, runner.period_s, limits.braking_m_s2)
            outcome = self._carry_out(motion, limits, notes, lambda: motion.travel_m)
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
                mean, sd = mean_and_sd(motion.observed_raw)
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
            runner, limits = self._runner, self._limits()
            start = runner.forward(runner.joints_rad)
            path = line(self._arm, self._pose_flange_peg, start, direction, command.travel_m, runner.joints_rad)
            search = SearchPath(command.path, start.rotation, direction, runner.period_s)
            stretch = path_stretch(search.fastest_m_s, command.axial_force_n, limits)
            if stretch > 1.0:
                refuse_longer("path", command.path[-1].time_s * stretch, self._config.motion_s)
                search = SearchPath(command.path, start.rotation, direction, runner.period_s, stretch)
            asked, (command, notes) = command, judged_admittance(command, limits, search.fastest_m_s)
            if stretch > 1.0:
                notes.append(f"path slowed by {stretch:.3g}: faster could press beyond the cap")
            # what goes slower needs longer
            longer = max(stretch, asked.speed_m_s / command.speed_m_s)
            command = command.model_copy(update={"timeout_s": min(command.timeout_s * longer, self._config.motion_s)})
            self._refuse_collision(path.joints(PATH_KNOTS))
            path.check_speed(command.speed_m_s + command.lateral_speed_limit_m_s + search.fastest_m_s)
            self._require_payload()
            motion = Admittance(self._arm, self._pose_flange_peg, start, direction, command, search, runner.period_s)
            return self._carry_out(motion, limits, notes, lambda: motion.travel_m)

    def dwell(self, command: Dwell) -> MotionOutcome:
        """The wrench is the mean of the dwell, less its first 30 ms."""
        with self._command():
            motion = Hold(command.duration_s)
            outcome = self._carry_out(motion, self._limits(), [], lambda: 0.0)
            if len(motion.samples) < 2:
                return outcome
            mean, sd = mean_and_sd(np.array(motion.samples))
            return outcome.model_copy(update={"wrench_raw": floats(mean), "wrench_sd": floats(sd)})

    def set_payload(self, command: SetPayload) -> None:
        """Raises CommandRefused: not_finite, direction, implausible_payload where the sensor says otherwise at rest."""
        refuse_not_finite("bias", command.bias)
        refuse_not_finite("centroid_ft_m", [command.weight_n, *command.centroid_ft_m])
        unit_direction("gravity_base", command.gravity_base)
        payload = Payload.from_command(command, self._mounting)
        with self._turn.taken():
            self._require_open()
            runner = self._runner
            runner.recover()
            if len(runner.last_samples) < (runner.last_samples.maxlen or 0):
                self._execution.hold_still(LAST_S)
            mean, sd = (
                mean_and_sd(np.array(runner.last_samples)) if runner.last_samples else (np.zeros(6), np.full(6, np.inf))
            )
            why = judge_payload(payload, mean, sd, runner.rotation_base_peg, self._payload_limits)
            if why is not None:
                raise CommandRefused(IMPLAUSIBLE, why)
            runner.use_payload(payload)

    # --------------------------------------------------------------------------------------- stops, and whose turn

    def accept(self) -> None:
        """A motion was accepted and is about to begin: from now on a stop ends it."""
        self._execution.accept()

    def done(self) -> None:
        """The accepted motion has ended or did not begin."""
        self._execution.done()

    def stop(self) -> bool:
        """End whatever moves or is about to, at the next cycle; whether anything did. Any thread may call."""
        return self._execution.stop()

    def hold_still(self, duration_s: float) -> None:
        """Hold still for a time, for whoever has the turn: a simulated camera exposes meanwhile."""
        self._runner.recover()
        self._execution.hold_still(duration_s)

    @contextmanager
    def exclusively(self) -> Iterator[None]:
        """No command may run beside this, and nothing steps the cell. Raises CommandRefused busy."""
        with self._alone(), self._turn.taken():
            yield

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """No command may run beside this. Raises CommandRefused busy."""
        if not self._commanded.acquire(blocking=False):
            raise CommandRefused("busy", "another command is being carried out; wait for it or stop it")
        try:
            self._require_open()
            yield
        finally:
            self._commanded.release()

    def _require_open(self) -> None:
        """Devices are let go of while commands may still come."""
        if self._closing.is_set():
            raise CommandRefused("stopping", "the arm's service is being stopped: nothing moves any more")

    @contextmanager
    def between_motions(self) -> Iterator[None]:
        """Wait for a motion to end, and let none begin meanwhile."""
        with self._commanded, self._turn.taken():
            yield

    def restart(self) -> None:
        """The arm was put somewhere else, by a reset: nothing of what was before is known. Call it exclusively."""
        self._runner.restart()

    def close(self) -> None:
        """Stop all motion, end the loop, tell the arm to stand. A second call does nothing."""
        self._closing.set()  # before the stop: whoever commanded what is stopped would command the next
        self.stop()
        if self._idler is not None:
            self._idler.join()
            self._idler = None
        with self.between_motions():
            self._joints.halt()

    def _idle(self) -> None:
        try:
            self._hold_until_closed()
        except Exception as error:
            # nobody reads arm and sensor between motions any more: no service is better than one that looks healthy
            traceback.print_exc()
            self.broken = f"the arm's loop ended by {type(error).__name__}: {error}; the arm is halted"
            with suppress(Exception):
                self._joints.halt()
            self.on_broken(self.broken)

    def _hold_until_closed(self) -> None:
        while not self._closing.is_set():
            with self._turn.idle():
                # a device that refuses where it is to go, backing off from what it felt, holds on where it is
                # one that was lost is asked for again
                with suppress(CommandRefused):
                    self._runner.recover()
                    self._execution.hold_still(self._runner.period_s)
                self.holder.drop_expired(self._runner.now_ns)

    @contextmanager
    def _command(self) -> Iterator[None]:
        """One command at a time. It is judged while the idle loop goes on: an arm in real time waits for nobody."""
        with self._alone():
            if self.broken:
                raise DeviceLost(self.broken)
            with self._turn.taken():
                self._runner.recover()
                self._execution.accept()
                self._start_joints = self._runner.joints_rad
            try:
                yield
            finally:
                self._execution.done()

    def _carry_out(
        self, motion: Motion, limits: TouchingLimits, notes: list[str], travel_m: Callable[[], float] | None = None
    ) -> MotionOutcome:
        """Run what was judged. Raises CommandRefused wrong_start where the arm does not stand as it did, DeviceLost."""
        steps, reference = self._execution.begun(motion)
        with self._turn.taken():
            self._runner.recover()
            if not np.array_equal(self._runner.joints_rad, self._start_joints):
                raise CommandRefused("wrong_start", "the arm backed off or was away meanwhile; plan anew")
            self._execution.restart()
            self._start_ns = self._runner.now_ns
            ending = self._execution.run(steps, reference, limits)
            return self._done(ending, None if travel_m is None else travel_m(), notes)

    def _refuse_collision(self, joints_rad: Array) -> None:
        """Before anything moves: what the arm's parts would come too near to on a way (k, n). Raises CommandRefused."""
        violation = self._collisions.check_path(joints_rad, working=True)
        if violation is not None:
            raise CommandRefused("collision", str(violation))

    def _limits(self) -> TouchingLimits:
        return TouchingLimits.at(
            self._config, self._landing, self._arm, self._stiffness_nm_rad, self._runner.joints_rad,
            self._pose_flange_tip, self._runner.period_s,
        )  # fmt: skip

    def _require_payload(self) -> None:
        """A tare would take a load that is already there for no contact. Raises CommandRefused no_payload."""
        if self._runner.payload is None:
            raise CommandRefused(
                "no_payload",
                "the arm does not know what hangs on its sensor, so a load that is there already would be missed; set "
                "the payload first: `crosspih calibrate ft`, then arm/set_payload",
            )

    def _done(self, ending: MotionEnding, travel_m: float | None, notes: list[str]) -> MotionOutcome:
        runner, execution = self._runner, self._execution
        pose = runner.forward(runner.measured_rad)
        runner.face(pose.rotation)
        if travel_m is None:
            travel_m = pose.distance_to_m(runner.forward(self._start_joints))
        runner.speeds_rad_s = np.zeros(len(runner.joints_rad))
        mean, sd = mean_and_sd(np.array(runner.last_samples)) if runner.last_samples else (np.zeros(6), np.zeros(6))
        return MotionOutcome(
            stamp_ns=runner.now_ns,
            stop_reason=ending.reason,
            detail=ending.detail,
            notes=tuple(notes),
            start_stamp_ns=self._start_ns,
            duration_s=(runner.now_ns - self._start_ns) * 1e-9,
            travel_m=travel_m,
            joints_rad=floats(runner.measured_rad),
            pose_base_peg=PoseData.of(pose),
            wrench_raw=floats(mean),
            wrench_sd=floats(sd),
            peak_force_n=execution.peak_force_n,
            peak_moment_nm=execution.peak_moment_nm,
            **dataclasses.asdict(self._effort.figures()),
        )
