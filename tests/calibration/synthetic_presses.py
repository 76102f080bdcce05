"""Pushes reckoned from the mechanics of a spring-jointed arm on a plane, without any code of the fits but the posture's
corner: for known stiffness, sensor mounting and peg."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.arm.inverse import InverseError, nearest
from crosspih_common.calibration.presses import Press, Pressed, RestLevel, touching_corner
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

WORKCELL = Workcell()
WEIGHT = np.array([0.0, 0.0, -9.555])
BIAS = np.array([0.17, -0.04, -0.01, -0.002, 0.014, -0.007])
CENTROID_M = np.array([0.0006, 0.0011, 0.0327])


@dataclass(frozen=True)
class Machine:
    """What is hidden: factors of the joints' stiffness, the sensor's turn and place, the peg's shift, and the
    noise (one sd of a dwell's mean, N and Nm)."""

    factors: Array = field(default_factory=lambda: np.ones(6))
    turn_rad: Array = field(default_factory=lambda: np.zeros(3))
    sensor_m: Array = field(default_factory=lambda: np.zeros(3))
    peg_m: Array = field(default_factory=lambda: np.zeros(3))
    noise_n: float = 0.0046  # of 0.1 N a sample over half a second
    noise_nm: float = 0.00023
    friction: float = 0.1
    edge_m: float = 0.0  # by which the tip's corners, right-angled, are rounded


def _cross(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class Rig:
    """A plane somewhere before the arm, and pushes on it."""

    def __init__(self, machine: Machine, seed: int) -> None:
        self.machine, self.rng = machine, np.random.default_rng(seed)
        nominal = WORKCELL.hole_prior.pose_base_hole()
        off = Pose.from_rotvec([*self.rng.uniform(-0.05, 0.05, 2), 0.0], [0.0, 0.0, self.rng.uniform(-5e-3, 5e-3)])
        self.plane = nominal @ off
        self.normal = self.plane.rotation[:, 2]
        self.home = np.asarray(WORKCELL.home_joints_rad, float)

    def level(self, joints: Array, force_base: Array, point_peg: Array) -> RestLevel:
        """What encoders and sensor say at rest with a force (3,) of the base at a point (3,) of the peg."""
        machine, rotation = self.machine, WORKCELL.pose_base_peg(joints).rotation
        force, weight = rotation.T @ force_base, rotation.T @ WEIGHT
        moment = np.cross(point_peg, force) + np.cross(CENTROID_M, weight)
        force = force + weight
        sensor = Rotation.from_rotvec(machine.turn_rad).as_matrix()
        felt = np.concatenate([sensor.T @ force, sensor.T @ (moment - np.cross(machine.sensor_m, force))]) + BIAS
        sd = np.repeat([machine.noise_n, machine.noise_nm], 3)
        raw = felt + self.rng.normal(size=6) * sd
        return RestLevel(joints_rad=tuple(joints.tolist()), raw=tuple(raw.tolist()), raw_sd=tuple(sd.tolist()))

    def press(self, tilt: float, side: float, spin: float, at: float, forces: tuple[float, ...]) -> Press | None:
        """One push; None where no posture of the arm does it."""
        peg, arm = WORKCELL.peg.shape(), WORKCELL.arm()
        lean = Rotation.from_rotvec(tilt * np.array([-np.sin(side), np.cos(side), 0.0]))
        rotation = self.plane.rotation @ (lean * Rotation.from_rotvec([0.0, 0.0, spin])).as_matrix()
        corner, _ = touching_corner(peg, rotation, self.normal)
        inwards = -np.array([*np.sign(corner[:2]), 1.0])
        real = corner + self.machine.peg_m + self.machine.edge_m * (inwards + rotation.T @ self.normal)
        place = self.plane.apply([0.042 * np.cos(at), 0.042 * np.sin(at), 0.0])
        touching = Pose(rotation, place - rotation @ real)
        back = WORKCELL.pose_flange_peg().inverse()
        try:
            joints = nearest(arm, touching @ back, self.home)
        except InverseError:
            return None
        whole = arm.jacobian(joints, WORKCELL.pose_flange_peg())
        at_corner = whole[:3] - _cross(rotation @ real) @ whole[3:]
        stiffness = np.asarray(WORKCELL.joint_stiffness_nm_rad) * self.machine.factors
        across = np.linalg.svd(self.normal[None])[2][1:]
        rubbing = self.rng.uniform(-1.0, 1.0, 2) * self.machine.friction
        levels = []
        try:
            for force in forces:
                on_peg = -force * self.normal + force * (rubbing @ across)
                gives = float(self.normal @ (at_corner @ ((at_corner.T @ on_peg) / stiffness)))
                deeper = Pose(rotation, touching.translation_m - self.normal * gives)
                levels.append(self.level(nearest(arm, deeper @ back, joints), on_peg, real))
            free = Pose(rotation, touching.translation_m - self.normal * 0.003)
            before = nearest(arm, free @ back, joints)
        except InverseError:
            return None
        return Press(free=self.level(before, np.zeros(3), real), levels=tuple(levels))

    def pressed(
        self, count: int = 16, forces: tuple[float, ...] = (4.0, 8.0, 12.0), tilts: tuple[float, ...] = (0.2, 0.42),
        corners: int = 8, weighings: int = 8, wrist: float = 1.2,
    ) -> Pressed:  # fmt: skip
        """A whole take."""
        presses: list[Press] = []
        number = 0
        while len(presses) < count:
            number += 1
            side = self.rng.uniform(0.0, 2.0 * np.pi)
            spin = (side - np.pi / 8 - (number % corners) * np.pi / 4 + np.pi) % (2.0 * np.pi) - np.pi
            if abs(spin) > 1.8:
                continue
            at = self.rng.uniform(0.0, 2.0 * np.pi)
            press = self.press(tilts[number % len(tilts)], side, spin, at, forces)
            if press is not None:
                presses.append(press)
        weighed = []
        for _ in range(weighings):
            joints = self.home.copy()
            joints[3:] += self.rng.uniform(-wrist, wrist, 3)
            weighed.append(self.level(joints, np.zeros(3), np.zeros(3)))
        return Pressed.model_validate({
            "taken_at": "2026-01-01T00:00:00+00:00", "normal_base": tuple(self.normal.tolist()),
            "presses": tuple(presses), "weighings": tuple(weighed),
        })  # fmt: skip
