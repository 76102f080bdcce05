"""The loop: one call is one cycle of the arm, for the joints, the sensor, the clock and the listeners.

Nothing here knows what the devices are. The period is the joint device's own; a sensor may be faster (its samples of a
cycle are averaged for control, and all of them are passed on) or slower (the last one stands).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import sqrt

import numpy as np

from crosspih_common.errors import DeviceLost
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import matrix_of, rows_of
from crosspih_common.messages import JointState, RawWrenchBatch
from crosspih_common.wrench import Payload, SensorMounting
from services.hardware.control.cycle import CycleReading, Reference, Wrench6
from services.hardware.control.trail import Trail
from services.hardware.protocols import JointDevice, WrenchDevice

JOINT_STATE_NS = 4_000_000
TICK_NS = 20_000_000
BATCH_NS = 10_000_000
LAST_S = 0.025  # over which an outcome's wrench is averaged


class Runner:
    """Owns the time of one arm. Everything that moves or measures goes through `advance`."""

    def __init__(
        self, joints: JointDevice, wrench: WrenchDevice, pose_flange_peg: Pose, mounting: SensorMounting
    ) -> None:
        self._joints, self._wrench = joints, wrench
        self.model = joints.model
        self.period_s = joints.period_s
        self._period_ns = round(joints.period_s * 1e9)
        self._still: Reference | None = None
        self._sample_ns = round(wrench.period_s * 1e9)
        self._pose_flange_peg = pose_flange_peg
        self._tick_listeners: list[Callable[[int], object]] = []
        self._joint_listeners: list[Callable[[JointState], object]] = []
        self._batch_listeners: list[Callable[[RawWrenchBatch], object]] = []
        self.now_ns = 0
        self.missed_cycles = 0
        self.sensor_silent_s = 0.0
        self.payload: Payload | None = None
        self._mounting = mounting
        self._peg_of_raw = None if np.array_equal(mounting.peg_of_raw, np.eye(6)) else mounting.peg_of_raw
        self._tare = Payload.tare(np.zeros(6), mounting)
        self.last_samples: deque[Array] = deque(maxlen=max(2, round(LAST_S / wrench.period_s)))
        self.trail = Trail()
        self._lost = False
        self._batch: list[list[float]] = []
        self._batch_ns = 0
        self.restart()

    # --------------------------------------------------------------------------------------------------- listeners

    def on_tick(self, listener: Callable[[int], object]) -> None:
        """Called with the time, ns, about 50 times a second."""
        self._tick_listeners.append(listener)

    def on_joint_state(self, listener: Callable[[JointState], object]) -> None:
        """Called 250 times a second, or once a cycle where that is slower."""
        self._joint_listeners.append(listener)

    def on_batch(self, listener: Callable[[RawWrenchBatch], object]) -> None:
        """Called with every sample of the sensor, in batches of about 10 ms."""
        self._batch_listeners.append(listener)

    # ------------------------------------------------------------------------------------------------------- state

    def restart(self) -> None:
        """The arm stands somewhere, from where nothing is known: no memory of forces or of a way.

        Raises DeviceLost.
        """
        state = self._joints.read()
        self.now_ns = state.stamp_ns
        self.joints_rad = np.array(state.positions_rad, dtype=float)
        self._at_rest = np.zeros(len(self.joints_rad))
        self.speeds_rad_s = self._at_rest
        self.measured_rad, self._measured_rad_s = self.joints_rad, self.speeds_rad_s
        self._rotation_base_peg = rows_of(self.forward(self.joints_rad).rotation)
        self._wrench.read()
        self._raw = np.zeros(6)
        self._tare = Payload.tare(np.zeros(6), self._mounting)
        self._reload()
        self.sensor_silent_s = 0.0
        self.last_samples.clear()
        self._batch.clear()
        self.trail.restart(self.joints_rad)
        self._remember_joints()

    def forward(self, joints_rad: Array) -> Pose:
        """`pose_base_peg` of the encoders' side at joints (n,)."""
        return self.model.pose_base_flange(joints_rad) @ self._pose_flange_peg

    def joint_state(self) -> JointState:
        """The encoders as last told."""
        return self._joint_state

    def last_contact(self) -> Array:
        """The contact wrench (6,) on the peg, peg frame, of the last cycle.

        A reading that is not a number stays one: it then trips the caps.
        """
        return np.array(self._contact(self._raw.tolist()))

    def _contact(self, raw: list[float]) -> Wrench6:
        on_peg = raw if self._peg_of_raw is None else (self._peg_of_raw @ raw).tolist()
        fx, fy, fz, mx, my, mz = on_peg
        ax, ay, az, bx, by, bz = self._load
        return fx - ax, fy - ay, fz - az, mx - bx, my - by, mz - bz

    def face(self, rotation_base_peg: Array) -> None:
        """The peg is turned so, (3, 3): a payload that is judged next is judged there."""
        self._rotation_base_peg = rows_of(rotation_base_peg)

    @property
    def rotation_base_peg(self) -> Array:
        """How the peg is turned (3, 3), as last told."""
        return matrix_of(self._rotation_base_peg)

    def use_payload(self, payload: Payload | None) -> None:
        """From now on contact is what this leaves; with None what is felt before a motion is no contact."""
        self.payload = payload
        self._reload()

    def tare(self) -> None:
        """Without a known payload: what the last samples hold is not contact."""
        if self.payload is None and self.last_samples:
            self._tare = Payload.tare(np.mean(self.last_samples, axis=0), self._mounting)
            self._reload()

    def _reload(self) -> None:
        self._load = (self.payload or self._tare).load_of(self._rotation_base_peg)

    def _remember_joints(self) -> None:
        self._joint_state = JointState(
            stamp_ns=self.now_ns,
            joints_rad=tuple(self.measured_rad.tolist()),
            speeds_rad_s=tuple(self._measured_rad_s.tolist()),
        )

    def still(self) -> Reference:
        """Stay where the reference is."""
        still = self._still
        if still is None or still.joints_rad is not self.joints_rad:
            still = self._still = Reference(self.joints_rad, self._at_rest)
        return still

    def recover(self) -> None:
        """After a device was lost: from where the arm stands now, which need not be where it was told to go.

        Raises DeviceLost while it is away.
        """
        if self._lost:
            self.restart()
            self._lost = False
            self.advance(self.still())

    # ------------------------------------------------------------------------------------------------------- cycle

    def advance(self, reference: Reference) -> CycleReading:
        """One cycle. Raises DeviceLost; `recover` before the next one."""
        try:
            self._joints.write(reference.joints_rad, reference.speeds_rad_s)
            state = self._joints.read()
        except DeviceLost:
            self._lost = True
            raise
        samples = self._wrench.read()
        before_ns, self.now_ns = self.now_ns, state.stamp_ns
        if self.now_ns - before_ns != self._period_ns:
            self.missed_cycles += max(0, round((self.now_ns - before_ns) / self._period_ns) - 1)
        if not reference.retracing and reference.joints_rad is not self.joints_rad:
            self.trail.follow(reference.joints_rad)
        self.joints_rad, self.speeds_rad_s = reference.joints_rad, reference.speeds_rad_s
        self.measured_rad, self._measured_rad_s = state.positions_rad, state.speeds_rad_s
        if reference.rotation_base_peg is not None:
            self._rotation_base_peg = reference.rotation_base_peg
            self._reload()
        rows: list[list[float]] = samples.wrenches.tolist()
        if len(rows) == 1:
            self.sensor_silent_s = 0.0
            self._raw = samples.wrenches[0]
            self.last_samples.append(self._raw)
            contact = self._contact(rows[0])
        else:
            if rows:
                self.sensor_silent_s = 0.0
                self._raw = samples.wrenches.mean(axis=0)
                self.last_samples.extend(samples.wrenches)
            else:
                self.sensor_silent_s += (self.now_ns - before_ns) * 1e-9
            contact = self._contact(self._raw.tolist())
        self._publish(before_ns, samples.stamps_ns.tolist(), rows)
        fx, fy, fz, mx, my, mz = contact
        force_n, moment_nm = sqrt(fx * fx + fy * fy + fz * fz), sqrt(mx * mx + my * my + mz * mz)
        return CycleReading(samples.wrenches, self._raw, contact, force_n, moment_nm, state.positions_rad)

    def _publish(self, before_ns: int, stamps_ns: list[int], samples: list[list[float]]) -> None:
        now = self.now_ns
        if now // JOINT_STATE_NS != before_ns // JOINT_STATE_NS:
            self._remember_joints()
            for on_state in self._joint_listeners:
                on_state(self._joint_state)
        if self._batch_listeners:
            for stamp_ns, sample in zip(stamps_ns, samples, strict=True):
                self._add_to_batch(stamp_ns, sample)
        if now // TICK_NS != before_ns // TICK_NS:
            for on_tick in self._tick_listeners:
                on_tick(now)

    def _add_to_batch(self, stamp_ns: int, sample: list[float]) -> None:
        batch = self._batch
        if batch and stamp_ns - self._batch_ns > (len(batch) + 1) * self._sample_ns:
            self._send_batch()  # samples are missing, and a batch has none that are
        if not batch:
            self._batch_ns = stamp_ns
        batch.append(sample)
        if stamp_ns - self._batch_ns + self._sample_ns >= BATCH_NS:
            self._send_batch()

    def _send_batch(self) -> None:
        rows = tuple(map(tuple, self._batch))
        self._batch.clear()
        batch = RawWrenchBatch(stamp_ns=self._batch_ns, period_ns=self._sample_ns, samples=rows)
        for on_batch in self._batch_listeners:
            on_batch(batch)
