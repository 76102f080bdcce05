"""Measures a cell for the checks: listens, holds the arm, tilts the wrist a little, sends commands that must be
refused.

Each step needs the one before it. Nothing moves before the clock, the streams and the joints' units are sound. The
wrist is not tilted with a sensor that reads absurd values. The commands that must be refused are chosen so that a cell
which obeys them does next to nothing.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from crosspih_common.bus import Bus, Latest
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, CrosspihError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.holding import ArmLease, hold_arm
from crosspih_common.holding.soundness import boots
from crosspih_common.keys import (
    CAMERA_ALIVE,
    CAMERA_CALIBRATION,
    CAPTURE,
    CLOCK,
    DWELL,
    FT_CALIBRATION,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    MOVE_LINEAR,
    STOP,
    WRENCH_RAW,
)
from crosspih_common.messages import (
    CaptureStereo,
    CellClock,
    Dwell,
    FtCalibration,
    JointState,
    MotionOutcome,
    MoveLinear,
    PoseData,
    RawWrenchBatch,
    StopMotion,
    StopReason,
)
from services.operator.cell.check import gravity, images, presence, streams
from services.operator.cell.check.provoking import provoke
from services.operator.cell.check.refused import check_held_still, check_stop
from services.operator.cli.rows import Row, skipped, wrong, wrong_ones

ASK_S = 120.0  # a move at the slow speed of a busy machine
TICKS, STATES, BATCHES = 512, 8192, 4096
LISTEN_S = 0.5
STILL_TRIES = 2
AT_HOLE_M = 0.06
TILTS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
SIZES = (1.0, 0.6, 0.3)  # shares of the tilt, tried in this order
STOP_MOVE_M, STOP_SPEED_M_S, STOP_TRIES = 0.002, 0.0005, 3


@dataclass(frozen=True, slots=True)
class CheckManner:
    """How gently: the tilt of the wrist, its speed, the dwells, and how long to wait for missing services."""

    tilt_rad: float = 0.3
    turn_rad_s: float = 0.3
    line_m_s: float = 0.02
    dwell_s: float = 0.3
    settle_s: float = 0.15
    patience_s: float = 3.0
    provoking: bool = True  # also send commands that must be refused
    tilting: bool = True
    camera_needed: bool = True
    arm: bool = True  # False: the cameras alone


@dataclass(frozen=True, slots=True, eq=False)
class _Heard:
    """The stream samples during one motion."""

    outcome: MotionOutcome
    ticks: list[CellClock]
    states: list[JointState]
    batches: list[RawWrenchBatch]


class Measurer:
    """One check of a cell through an operator's bus."""

    def __init__(self, bus: Bus, workcell: Workcell, manner: CheckManner, say: Callable[[str], None]) -> None:
        self._bus, self._workcell, self._manner, self._say = bus, workcell, manner, say
        self._arm = workcell.arm()
        self._alive: set[str] = set()
        self._changed = threading.Condition()
        self._rejected: list[str] = []
        self._calibration: Latest[FtCalibration] = bus.latest(FT_CALIBRATION)
        bus.watch_alive(self._on_alive)
        self.checks: list[Row] = []

    def _on_alive(self, service: str, alive: bool) -> None:
        with self._changed:
            (self._alive.add if alive else self._alive.discard)(service)
            self._changed.notify_all()

    def run(self) -> list[Row]:
        """All checks, in order. Nothing raises: a check that cannot be made is a line of the table."""
        before, self._bus.on_reject = self._bus.on_reject, self._rejected.append
        try:
            self._run()
        finally:
            self._bus.on_reject = before
        return self.checks

    def _run(self) -> None:
        if self._manner.arm:
            self._look_at_arm()
        self._say("taking a pair of pictures")
        self._camera()
        self.checks.append(presence.check_contract([why for why in self._rejected if "image" not in why]))

    def _look_at_arm(self) -> None:
        self._say("listening")
        ticks, sound = self._listen()
        if sound:
            self._say("holding still")
            try:
                with hold_arm(self._bus, "cell check") as lease:
                    self._held(lease, ticks)
            except CrosspihError as error:
                self.checks.append(wrong("arm", str(error), "see docs/wire.md for what the arm serves"))

    # ----------------------------------------------------------------------------------------------------- listening

    def _wait_alive(self, service: str) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: service in self._alive, self._manner.patience_s)

    def _listen(self) -> tuple[list[CellClock], bool]:
        """Listens to the ticks; returns whether there is one cell to go on with. A missing token alone does not prevent
        that.
        """
        alive = self._wait_alive("hardware")
        with self._bus.reading(CLOCK, TICKS) as clock:
            heard = clock.wait_for(lambda _: True, self._manner.patience_s) is not None
            if heard:
                clock.wait_for(lambda _: len(boots(clock.values())) > 1, LISTEN_S)
            ticks = clock.values()
        self.checks.append(presence.check_token("hardware", alive, heard))
        self.checks.append(presence.check_one_cell(self._bus.cell, ticks))
        if not ticks:
            self.checks.append(presence.check_clock(ticks))
        return ticks, not wrong_ones(self.checks[1:])

    def _during(self, motion: Callable[[], MotionOutcome]) -> _Heard:
        with (
            self._bus.reading(CLOCK, TICKS) as clock,
            self._bus.reading(JOINT_STATE, STATES) as states,
            self._bus.reading(WRENCH_RAW, BATCHES) as batches,
        ):
            outcome = motion()
            # stream samples may arrive after the reply
            close_ns = outcome.stamp_ns - 20_000_000
            states.wait_for(lambda state: state.stamp_ns >= close_ns, LISTEN_S)
            batches.wait_for(lambda batch: batch.stamp_ns >= close_ns, LISTEN_S)
            return _Heard(outcome, clock.values(), states.values(), batches.values())

    # ------------------------------------------------------------------------------------------------------- holding

    def _held(self, lease: ArmLease, ticks: list[CellClock]) -> None:
        realtime = ticks[-1].realtime
        for _ in range(STILL_TRIES):
            still = self._during(lambda: lease.ask(DWELL, Dwell(duration_s=self._manner.dwell_s), ASK_S))
            judged = self._judged_still(still)
            if not wrong_ones(judged):
                break  # a stream drops samples on a busy machine: one loss is no verdict
        self.checks += judged
        if wrong_ones(judged):
            self.checks.append(skipped("motion", "nothing is moved before the lines above are mended"))
            return
        peg = still.outcome.pose_base_peg.pose()
        if self._manner.provoking:
            self._say("asking what must be refused")
            self.checks += provoke(
                self._bus,
                lease,
                self._arm,
                self._workcell.sensor_mounting(),
                still.outcome,
                self._calibration.value(),
            )
        nominal = self._workcell.hole_prior.pose_base_hole()
        tip = nominal.inverse().apply(peg.apply([0.0, 0.0, self._workcell.peg.shape().tip_m]))
        if np.hypot(tip[0], tip[1]) < AT_HOLE_M and tip[2] > -AT_HOLE_M:
            said = "the peg is at the hole: take it out (`crosspih withdraw`) and home it, then check again"
            self.checks += [skipped(name, said) for name in ("stop", gravity.SIGN, gravity.UNIT, gravity.MOMENT)]
            return
        self._say("a slow move, and a stop in it")
        try:
            self.checks.append(self._stop(lease, peg, realtime))
        except CommandRefused as refusal:
            self.checks.append(skipped("stop", f"no room to draw back by 2 mm: {refusal}"))
        if self._manner.tilting:
            self._say("tilting the wrist")
            self._tilt(lease, peg)

    def _judged_still(self, still: _Heard) -> list[Row]:
        checks: list[Row] = []
        outcome, states, batches = still.outcome, still.states, still.batches
        start, end = outcome.start_stamp_ns, outcome.stamp_ns
        stamps = [tick.stamp_ns for tick in still.ticks]
        within = [tick for tick, stamp in zip(still.ticks, stamps, strict=True) if stamp >= start]
        checks += wrong_ones([presence.check_one_cell(self._bus.cell, still.ticks)])  # passed before, while listening
        checks.append(streams.check_joint_units(outcome.joints_rad, self._arm))
        if outcome.stop_reason is not StopReason.COMPLETED:
            checks.append(gravity.check_range(outcome.wrench_raw, self._workcell))
            checks.append(check_held_still(outcome))
            return checks
        checks.append(presence.check_clock(within))
        checks.append(streams.check_joint_rate(states))
        checks.append(streams.check_stamps(JOINT_STATE.path, [one.stamp_ns for one in states], start, end))
        checks.append(streams.check_joint_outcome(states, outcome))
        on_clock = streams.check_stamps(WRENCH_RAW.path, [one.stamp_ns for one in batches], start, end)
        checks += [on_clock, streams.check_wrench_period(batches)]
        if not wrong_ones([on_clock]):
            checks.append(streams.check_wrench_outcome(batches, outcome))
        checks.append(gravity.check_range(outcome.wrench_raw, self._workcell))
        return checks

    def _stop(self, lease: ArmLease, peg: Pose, realtime: bool) -> Row:
        away = PoseData.of(peg @ Pose.from_translation([0.0, 0.0, -STOP_MOVE_M]))
        slow = MoveLinear(pose_base_peg=away, speed_m_s=STOP_SPEED_M_S)
        best: Row | None = None
        for _ in range(STOP_TRIES if realtime else 1):
            with ThreadPoolExecutor(1) as asking, self._bus.reading(JOINT_STATE, 4):
                moving = asking.submit(lease.ask, MOVE_LINEAR, slow, ASK_S)
                heard, sent_ns = False, 0
                while not heard and not moving.done():
                    sent_ns = self._bus.clock.now_ns()
                    heard = self._bus.call(STOP, StopMotion(), ASK_S).was_moving
                    if not heard:
                        time.sleep(0.005)
                outcome = moving.result()
            latency_s = (outcome.stamp_ns - sent_ns) * 1e-9
            best = check_stop(outcome, heard, latency_s, realtime)
            self._go(lease, peg)
            if not wrong_ones([best]):
                break
        assert best is not None
        return best

    # ------------------------------------------------------------------------------------------------------- tilting

    def _go(self, lease: ArmLease, pose_base_peg: Pose) -> MotionOutcome:
        manner = self._manner
        asked = MoveLinear(
            pose_base_peg=PoseData.of(pose_base_peg),
            speed_m_s=manner.line_m_s,
            rotational_speed_rad_s=manner.turn_rad_s,
        )
        return lease.ask(MOVE_LINEAR, asked, ASK_S)

    def _tilt(self, lease: ArmLease, peg: Pose) -> None:
        readings, told = [self._reading(lease)], False
        pitch, roll = tilt_axes(peg.rotation, np.asarray(self._workcell.gravity_base_m_s2, float))
        size = self._manner.tilt_rad
        refused = ""
        for about_pitch, about_roll in TILTS:
            for share in SIZES:
                turn = Pose.from_rotvec(share * size * (about_pitch * pitch + about_roll * roll), [0.0, 0.0, 0.0])
                tilted = Pose(turn.rotation @ peg.rotation, peg.translation_m)
                try:
                    heard = self._during(lambda goal=tilted: self._go(lease, goal))  # type: ignore[misc]
                except CommandRefused as refusal:
                    refused = str(refusal)
                    continue
                if heard.outcome.stop_reason is not StopReason.COMPLETED:
                    self.checks.append(
                        wrong(
                            gravity.SIGN,
                            f"a tilt in free air was ended: {heard.outcome.stop_reason.value} {heard.outcome.detail}",
                            "free the tool; or the sensor reads more than there is (its units), or the cap is too low",
                        )
                    )
                    return
                if not told:
                    told = True
                    self.checks.append(streams.check_speeds(heard.states))
                    self.checks.append(
                        streams.check_pose_outcome(heard.outcome, tilted, self._arm, self._workcell.pose_flange_peg())
                    )
                readings.append(self._reading(lease))
                break
        self._go(lease, peg)
        felt = gravity.felt_weight(readings, self._workcell)
        if felt is None and refused:
            self.checks.append(skipped("tilts", f"refused: {refused}"))
        known, source = self._known_weight()
        self.checks.append(gravity.check_sign(felt, self._workcell))
        self.checks.append(gravity.check_unit(felt, self._workcell, known, source))
        self.checks.append(gravity.check_moment(felt))

    def _reading(self, lease: ArmLease) -> gravity.DwellReading:
        lease.ask(DWELL, Dwell(duration_s=self._manner.settle_s), ASK_S)
        outcome = lease.ask(DWELL, Dwell(duration_s=self._manner.dwell_s), ASK_S)
        return gravity.DwellReading(
            outcome.pose_base_peg.pose().rotation, np.asarray(outcome.wrench_raw), np.asarray(outcome.wrench_sd)
        )

    def _known_weight(self) -> tuple[float | None, str]:
        weighed_n = self._workcell.force_torque.weighed_n
        if weighed_n is not None:
            return weighed_n, "scales"
        calibration = self._calibration.value()
        if calibration is not None and calibration.calibrated:
            return calibration.weight_n, "the calibration"
        return None, ""

    # -------------------------------------------------------------------------------------------------------- camera

    def _camera(self) -> None:
        alive = self._wait_alive(CAMERA_ALIVE)
        with (
            self._bus.reading(IMAGE_LEFT, 4) as left,
            self._bus.reading(IMAGE_RIGHT, 4) as right,
            self._bus.reading(CAMERA_CALIBRATION) as told,
        ):
            try:
                pair = self._bus.call(CAPTURE, CaptureStereo(), ASK_S)
            except CrosspihError as error:
                if not alive and not self._manner.camera_needed:
                    self.checks.append(skipped("capture", "no camera is there"))
                    return
                self.checks.append(presence.check_token(CAMERA_ALIVE, alive, answers=False))
                self.checks.append(wrong("capture", str(error), "serve camera/capture (docs/wire.md)"))
                return
            self.checks.append(presence.check_token(CAMERA_ALIVE, alive, answers=True))
            pictures = []
            for side, heard in (("left", left), ("right", right)):
                picture = heard.wait_for(lambda image: image.stamp_ns == pair.stamp_ns, self._manner.patience_s)
                picture = picture or heard.value()
                why = next((why for why in self._rejected if "image" in why), "") if picture is None else ""
                pictures.append(picture)
                self.checks.append(images.check_image(side, picture, pair, why))
            calibration = told.wait_for(lambda _: True, LISTEN_S)
            self.checks.append(images.check_pair(pictures[0], pictures[1], pair, calibration))


def tilt_axes(rotation_base_peg: Array, gravity_base: Array) -> tuple[Array, Array]:
    """Two level axes (3,), unit vectors in the base frame, at right angles: a tilt about either changes the weight in
    the sensor's frame. The second is along the peg where the peg is level: a roll of the wrist.
    """
    down = gravity_base / np.linalg.norm(gravity_base)
    along = rotation_base_peg[:, 2]
    if np.linalg.norm(np.cross(down, along)) < 0.3:
        along = rotation_base_peg[:, 0]
    pitch = np.cross(down, along)
    pitch /= np.linalg.norm(pitch)
    return pitch, np.cross(pitch, down)


def check_cell(
    bus: Bus, workcell: Workcell, manner: CheckManner | None = None, say: Callable[[str], None] = lambda text: None
) -> list[Row]:
    """All checks of a running cell; `say` is called with each step."""
    return Measurer(bus, workcell, manner or CheckManner(), say).run()
