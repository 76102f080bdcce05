"""The 1 kHz loop: one call is one millisecond of the cell, for the physics, the sensor, the clock and the listeners."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import JointState, RawWrenchBatch
from crosspih_common.messages.base import floats
from services.hardware.control.payload import Payload
from services.hardware.drivers.simulated.engines.pybullet.engine import STEP_NS, STEP_S, Physics
from services.hardware.drivers.simulated.sensor import SensorModel

JOINT_STATE_NS = 4_000_000
TICK_NS = 20_000_000
BATCH = 10
LAST_SAMPLES = 25
TRAIL_STEP_RAD = 4e-5  # some 20 micrometres at the peg
_TRAIL_LENGTH = 5000


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Where the motor side is to be in a millisecond. Arrays (6,); a `pose_base_peg` of None keeps the last known."""

    joints_rad: Array
    speeds_rad_s: Array
    accelerations_rad_s2: Array
    pose_base_peg: Pose | None = None
    retracing: bool = False  # the way back is not a way that was come


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """What the controller knows after a millisecond: the raw and the contact wrench, (6,), in the peg frame."""

    raw: Array
    contact: Array
    force_n: float
    moment_nm: float


class Servo:
    """Owns the time. Everything that moves or measures goes through `advance`."""

    def __init__(self, workcell: Workcell, physics: Physics, sensor: SensorModel) -> None:
        self._arm_model = workcell.arm()
        self._pose_flange_peg = workcell.pose_flange_peg()
        self._physics = physics
        self._sensor = sensor
        self._tick_listeners: list[Callable[[int], object]] = []
        self._joint_listeners: list[Callable[[JointState], object]] = []
        self._batch_listeners: list[Callable[[RawWrenchBatch], object]] = []
        self._pace: Callable[[int], None] = lambda now_ns: None
        self.lock = threading.Lock()  # around one step: whoever looks at the physics from outside takes it
        self.now_ns = 0
        self._started_ns = 0
        self.joints_rad = np.zeros(6)
        self.speeds_rad_s = np.zeros(6)
        self.pose_base_peg = Pose.identity()
        self.payload: Payload | None = None
        self._tare = Payload.tare(np.zeros(6))
        self._load = np.zeros(6)
        self.last_raw: deque[Array] = deque(maxlen=LAST_SAMPLES)
        self._batch: list[Array] = []
        self._batch_ns = 0
        self.trail: deque[Array] = deque(maxlen=_TRAIL_LENGTH)
        self._joint_state = JointState(joints_rad=(0.0,) * 6, speeds_rad_s=(0.0,) * 6)

    def on_tick(self, listener: Callable[[int], object]) -> None:
        """Called with the time, ns, every 20 ms."""
        self._tick_listeners.append(listener)

    def on_joint_state(self, listener: Callable[[JointState], object]) -> None:
        """Called every 4 ms."""
        self._joint_listeners.append(listener)

    def on_batch(self, listener: Callable[[RawWrenchBatch], object]) -> None:
        """Called with every 10 samples."""
        self._batch_listeners.append(listener)

    def set_pace(self, pace: Callable[[int], None]) -> None:
        """What to call with the time after each step: it may wait for the wall clock."""
        self._pace = pace

    def restart(self, joints_rad: Array, rng: np.random.Generator) -> None:
        """A new trial: at rest at these joints, new noise, no memory of forces; time goes on."""
        self.joints_rad = np.array(joints_rad, dtype=float)
        self.speeds_rad_s = np.zeros(6)
        self.pose_base_peg = self.forward(self.joints_rad)
        self._sensor.start(rng)
        self._started_ns = self.now_ns
        self._tare = Payload.tare(np.zeros(6))
        self._reload()
        self.last_raw.clear()
        self._batch.clear()
        self.trail.clear()
        self.trail.append(self.joints_rad)
        self._remember_joints()

    def forward(self, joints_rad: Array) -> Pose:
        """`pose_base_peg` of the motor side at joints (6,)."""
        return self._arm_model.pose_base_flange(joints_rad) @ self._pose_flange_peg

    def joint_state(self) -> JointState:
        """The encoders at the last step."""
        return self._joint_state

    def use_payload(self, payload: Payload) -> None:
        """From now on contact is what this leaves."""
        self.payload = payload
        self._reload()

    def tare(self) -> None:
        """Without a known payload: what the last samples hold is not contact."""
        if self.payload is None and self.last_raw:
            self._tare = Payload.tare(np.mean(self.last_raw, axis=0))
            self._reload()

    def _reload(self) -> None:
        self._load = (self.payload or self._tare).load(self.pose_base_peg.rotation)

    def _remember_joints(self) -> None:
        self._joint_state = JointState(
            stamp_ns=self.now_ns, joints_rad=floats(self.joints_rad), speeds_rad_s=floats(self.speeds_rad_s)
        )

    def still(self) -> Reference:
        """Stay where the motor side is."""
        return Reference(self.joints_rad, np.zeros(6), np.zeros(6))

    def advance(self, reference: Reference) -> Reading:
        """One millisecond."""
        with self.lock:
            self._physics.step(reference.joints_rad, reference.speeds_rad_s, reference.accelerations_rad_s2)
            ideal = self._physics.wrench_sensed()
            self.now_ns += STEP_NS
        if not reference.retracing:
            self._follow_trail(reference.joints_rad)
        self.joints_rad = reference.joints_rad
        self.speeds_rad_s = reference.speeds_rad_s
        if reference.pose_base_peg is not None:
            self.pose_base_peg = reference.pose_base_peg
            self._reload()
        raw = self._sensor.sample(ideal, (self.now_ns - self._started_ns) * 1e-9)
        self.last_raw.append(raw)
        contact = raw - self._load
        self._publish(raw)
        self._pace(self.now_ns)
        force, moment = contact[:3], contact[3:]
        return Reading(raw, contact, float(np.sqrt(force @ force)), float(np.sqrt(moment @ moment)))

    def _publish(self, raw: Array) -> None:
        now = self.now_ns
        if now % JOINT_STATE_NS == 0:
            self._remember_joints()
            for on_state in self._joint_listeners:
                on_state(self._joint_state)
        if self._batch_listeners:
            if not self._batch:
                self._batch_ns = now
            self._batch.append(raw)
            if len(self._batch) == BATCH:
                samples = tuple(tuple(row) for row in np.array(self._batch).tolist())
                self._batch.clear()
                batch = RawWrenchBatch(stamp_ns=self._batch_ns, period_ns=STEP_NS, samples=samples)
                for on_batch in self._batch_listeners:
                    on_batch(batch)
        if now % TICK_NS == 0:
            for on_tick in self._tick_listeners:
                on_tick(now)

    def _follow_trail(self, joints_rad: Array) -> None:
        """The way that led here, without the parts that were gone back over."""
        trail = self.trail
        while len(trail) > 1 and np.abs(joints_rad - trail[-2]).sum() <= np.abs(trail[-1] - trail[-2]).sum() * 0.5:
            trail.pop()
        if np.abs(joints_rad - trail[-1]).max() >= TRAIL_STEP_RAD:
            trail.append(joints_rad)


def finite_difference_speed(before_rad: Array, after_rad: Array) -> Array:
    """The speed (6,), rad/s, that takes joints from one step to the next."""
    return np.asarray((after_rad - before_rad) / STEP_S)
