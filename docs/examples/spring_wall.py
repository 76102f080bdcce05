"""A driver in full: an arm whose joints go where they are told, and a sensor that feels a springy wall.

`hardware.driver: docs.examples.spring_wall:open_devices` in a cell's file opens it (docs/examples/spring-wall.yaml).
For a real arm replace what stands between the dashes by calls of its vendor's library; nothing else is needed: motions,
caps, stops, payload and streams are the control layer's.
"""

from __future__ import annotations

import time

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.registry import OpenRequest
from services.hardware.protocols import Devices, JointReading, WrenchSamples

PERIOD_S = 0.002  # a 500 Hz arm


class Joints:
    """Implements JointDevice: read waits for the next cycle, write says where to be in it."""

    def __init__(self, model: ArmModel, home_rad: Array, wait: bool) -> None:
        self.model, self.period_s, self._wait = model, PERIOD_S, wait
        # ---
        self.positions_rad, self.speeds_rad_s = home_rad, np.zeros(len(home_rad))
        self._cycle, self._next_s = 0, time.monotonic()
        # ---

    def read(self) -> JointReading:
        """Wait for the next cycle; what the encoders say in it."""
        # ---
        self._cycle += 1
        self._next_s += PERIOD_S
        if self._wait and (ahead_s := self._next_s - time.monotonic()) > 0.0:
            time.sleep(ahead_s)
        # ---
        return JointReading(self.now_ns(), self.positions_rad, self.speeds_rad_s)

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """Where to be in the next cycle."""
        self.positions_rad, self.speeds_rad_s = positions_rad, speeds_rad_s

    def halt(self) -> None:
        """Stand still."""
        self.speeds_rad_s = np.zeros(len(self.positions_rad))

    def now_ns(self) -> int:
        """The arm's clock."""
        return round(self._cycle * PERIOD_S * 1e9)


class WallSensor:
    """Implements WrenchDevice: the tool's weight, and a wall that pushes back with so many newtons a metre."""

    def __init__(self, joints: Joints, pose_flange_peg: Pose, tip_m: float, options: dict[str, float]) -> None:
        self.period_s = PERIOD_S
        self._joints, self._pose_flange_peg, self._tip_m = joints, pose_flange_peg, tip_m
        self._floor_z_m = options.get("wall_z_m", 0.2)
        self._stiffness_n_m = options.get("stiffness_n_m", 1e5)
        self._weight_n, self._centroid_m = options.get("weight_n", 8.0), np.array([0.0, 0.0, 0.03])

    def read(self) -> WrenchSamples:
        """The samples since the last read: here always one."""
        # ---
        peg = self._joints.model.pose_base_flange(self._joints.positions_rad) @ self._pose_flange_peg
        tip_m = peg.apply(np.array([0.0, 0.0, self._tip_m]))
        push_n = self._stiffness_n_m * max(0.0, self._floor_z_m - tip_m[2])
        wall, weight = (peg.rotation.T @ np.array([0.0, 0.0, z]) for z in (push_n, -self._weight_n))
        moment = np.cross([0.0, 0.0, self._tip_m], wall) + np.cross(self._centroid_m, weight)
        # ---
        stamps = np.array([self._joints.now_ns()], dtype=np.int64)
        return WrenchSamples(stamps, np.array([[*(wall + weight), *moment]]))


def open_devices(request: OpenRequest) -> Devices:
    """The arm and its sensor; the camera, if any, is another driver's or another process's."""
    workcell = request.workcell
    joints = Joints(workcell.arm(), np.asarray(workcell.home_joints_rad, float), wait=request.realtime)
    sensor = WallSensor(joints, workcell.pose_flange_peg(), workcell.peg.shape().tip_m, request.options)
    return Devices(joints=joints, wrench=sensor, realtime=request.realtime)
