"""The admittance move: push along a direction, yield to lateral force and to moment (Seraji 1994; Villani and De
Schutter, "Force Control", Springer Handbook of Robotics, section 9.2).

The contact wrench, filtered at 100 Hz, is turned into velocity about a centre near the rim:

    v_lateral = F_lateral / D,   w = M_centre / D_r,   v_axial = v (1 - load / F_max)

each clipped, plus the speeds of a search path where there is one. The load is the axial force, or a share of |F| when
the peg leans on a wall, or of |M|: a wedged peg can carry far more than its axial force says. A load beyond F_max lets
the peg come back.
"""

from __future__ import annotations

from collections import deque
from math import sqrt

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.arm.inverse import InverseError, nearest
from crosspih_common.geometry import Pose, skew
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import AdmittanceMove, StopReason
from services.hardware.control.cycle import Reading, Reference, finite_difference_speed
from services.hardware.control.motions import Ending, Steps, cycles
from services.hardware.control.runner import Runner
from services.hardware.control.search_path import SearchPath

FILTER_HZ = 100.0
STALL_SHARE = 0.02
_RAMP_M_S2 = 0.5
_MOMENT_LOAD_NM = 4.0
_EXACT_S = 0.005
_JACOBIAN_S = 0.05


class Admittance:
    """One admittance move; how far it came stands in `travel_m`."""

    def __init__(
        self, arm: ArmModel, pose_flange_peg: Pose, start: Pose, direction_base: Array, command: AdmittanceMove,
        search: SearchPath, period_s: float,
    ) -> None:  # fmt: skip
        self._arm = arm
        self._pose_flange_peg = pose_flange_peg
        self._peg_to_flange = pose_flange_peg.inverse()
        self._start = start
        self._direction = direction_base
        self._command = command
        self._search, self._period_s = search, period_s
        self.travel_m = 0.0

    def steps(self, runner: Runner) -> Steps:
        """Until seated, stalled, at the end of the search path or out of time."""
        command, direction, search, period_s = self._command, self._direction, self._search, self._period_s
        exact_every, jacobian_every = cycles(_EXACT_S, period_s), cycles(_JACOBIAN_S, period_s)
        smoothing = 1.0 - np.exp(-2.0 * np.pi * FILTER_HZ * period_s)
        centre_peg = np.asarray(command.centre_peg_m, float)
        pose = self._start
        begin = centre = pose.apply(centre_peg)
        joints = runner.joints_rad
        wrench = np.zeros(6)
        speed = 0.0
        window = cycles(command.stall_s, period_s)
        progress: deque[float] = deque([0.0], maxlen=window)
        to_joints: Array = np.eye(len(joints), 6)
        for index in range(cycles(command.timeout_s, period_s)):
            before = pose
            axial_speed, lateral, turn = self._velocities(wrench, pose)
            if search.steps:
                if index >= search.steps:
                    return Ending(StopReason.COMPLETED, "the search path is at its end")
                lateral = lateral + search.velocity_m_s[index]
                turn = turn + search.turn_rad_s[index]
            # gather speed gently, give way at once
            speed = min(axial_speed, speed + _RAMP_M_S2 * period_s)
            centre = centre + (direction * speed + lateral) * period_s
            # At 0.05 rad/s a step turns 5e-5 rad: the second order is exact to 1e-14.
            spin = skew(turn * period_s)
            rotation = pose.rotation + spin @ (pose.rotation + 0.5 * spin @ pose.rotation)
            pose = Pose(rotation, centre - rotation @ centre_peg)
            # The closed form every 5 ms, the Jacobian in between: nanometres apart, at a third of the time.
            if index % jacobian_every == 0:
                to_joints = np.asarray(np.linalg.pinv(self._arm.jacobian(joints, self._pose_flange_peg)), dtype=float)
            if index % exact_every == 0:
                try:
                    following = nearest(self._arm, pose @ self._peg_to_flange, joints)
                except InverseError as error:
                    return Ending(StopReason.STALLED, f"yielding led out of reach: {error}")
            else:
                moved = pose.translation_m - before.translation_m
                following = joints + to_joints @ np.concatenate([moved, turn * period_s])
            tip_speed = abs(speed) + sqrt(lateral @ lateral)
            speeds = finite_difference_speed(joints, following, period_s)
            reading: Reading = yield Reference(following, speeds, pose, tip_speed_m_s=tip_speed)
            joints = following
            wrench = wrench + smoothing * (reading.contact - wrench)
            self.travel_m = float((centre - begin) @ direction)
            if self.travel_m >= command.travel_m:
                return Ending(StopReason.SEATED)
            if (
                not search.steps
                and len(progress) == window
                and (self.travel_m - progress[0] < STALL_SHARE * command.speed_m_s * command.stall_s)
            ):
                return Ending(
                    StopReason.STALLED,
                    f"advanced {(self.travel_m - progress[0]) * 1e3:.2f} mm in the last {command.stall_s:g} s, "
                    f"{self.travel_m * 1e3:.2f} of {command.travel_m * 1e3:.2f} mm in all",
                )
            progress.append(self.travel_m)
        return Ending(StopReason.TIMED_OUT, f"{self.travel_m * 1e3:.2f} mm in {command.timeout_s:g} s")

    def _velocities(self, wrench: Array, pose: Pose) -> tuple[float, Array, Array]:
        command, direction = self._command, self._direction
        force = pose.rotation @ wrench[:3]
        fx, fy, fz, _, _, _ = wrench.tolist()
        x, y, z = command.centre_peg_m
        # the moment about the centre: M - c x F
        about = wrench[3:] - np.array([y * fz - z * fy, z * fx - x * fz, x * fy - y * fx])
        axial = float(-force @ direction)
        across = force + direction * axial
        lateral = _clip(across / command.lateral_damping_n_s_m, command.lateral_speed_limit_m_s)
        turn = _clip(pose.rotation @ about / command.rotational_damping_nm_s_rad, command.rotational_speed_limit_rad_s)
        load = max(
            axial / command.axial_force_n,
            0.5 * sqrt(force @ force) / command.axial_force_n,
            sqrt(about @ about) / _MOMENT_LOAD_NM,
        )
        return command.speed_m_s * min(1.0, max(-1.0, 1.0 - load)), lateral, turn


def _clip(vector: Array, length: float) -> Array:
    size = sqrt(vector @ vector)
    return vector if size <= length else vector * (length / size)
