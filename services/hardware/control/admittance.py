"""The admittance move: push along a direction, yield to lateral force and to moment by `AdmittanceLaw`, and go along a
search path where there is one.

The contact wrench is filtered at 100 Hz first. In plain floats, as the law itself: the joints alone are arrays.
"""

from __future__ import annotations

from collections import deque
from math import exp, pi, sqrt

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.arm.inverse import InverseError, solver
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import matrix_of, rows_of, turned
from crosspih_common.messages import AdmittanceMove, StopReason
from services.hardware.control.admittance_law import AdmittanceLaw
from services.hardware.control.cycle import CycleReading, Reference
from services.hardware.control.motions import MotionEnding, Steps, cycles
from services.hardware.control.runner import Runner
from services.hardware.control.search_path import SearchPath

FILTER_HZ = 100.0
STALL_SHARE = 0.02
_RAMP_M_S2 = 0.5
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
        self._start = start
        self._law = AdmittanceLaw.of(command, direction_base.tolist())
        self._command = command
        self._search, self._period_s = search, period_s
        self.travel_m = 0.0

    def steps(self, runner: Runner) -> Steps:
        """Until seated, stalled, at the end of the search path or out of time."""
        command, law, search, period_s = self._command, self._law, self._search, self._period_s
        solve, peg_to_flange = solver(self._arm), self._pose_flange_peg.inverse()
        exact_every, jacobian_every = cycles(_EXACT_S, period_s), cycles(_JACOBIAN_S, period_s)
        smoothing = 1.0 - exp(-2.0 * pi * FILTER_HZ * period_s)
        path_m_s, path_rad_s = search.velocity_m_s.tolist(), search.turn_rad_s.tolist()
        dx, dy, dz = law.direction
        # of the base frame: how the peg is turned, the peg frame's origin (x, y, z), the centre (cx, cy, cz)
        rotation = rows_of(self._start.rotation)
        x, y, z = self._start.translation_m.tolist()
        px, py, pz = law.centre_m
        bx, by, bz = cx, cy, cz = self._start.apply(law.centre_m).tolist()
        wrench = [0.0] * 6
        speed = 0.0
        joints = runner.joints_rad
        to_joints: Array = np.eye(len(joints), 6)
        window = cycles(command.stall_s, period_s)
        progress: deque[float] = deque([0.0], maxlen=window)
        for index in range(cycles(command.timeout_s, period_s)):
            axial_m_s, (vx, vy, vz), (wx, wy, wz) = law.yielding(wrench, rotation)
            if search.steps:
                if index >= search.steps:
                    return MotionEnding(StopReason.COMPLETED, "the search path is at its end")
                (along_x, along_y, along_z), (turn_x, turn_y, turn_z) = path_m_s[index], path_rad_s[index]
                vx, vy, vz = vx + along_x, vy + along_y, vz + along_z
                wx, wy, wz = wx + turn_x, wy + turn_y, wz + turn_z
            # gather speed gently, give way at once
            speed = min(axial_m_s, speed + _RAMP_M_S2 * period_s)
            cx += (dx * speed + vx) * period_s
            cy += (dy * speed + vy) * period_s
            cz += (dz * speed + vz) * period_s
            rotation = turned(rotation, wx * period_s, wy * period_s, wz * period_s)
            before_x, before_y, before_z = x, y, z
            r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
            x = cx - (r00 * px + r01 * py + r02 * pz)
            y = cy - (r10 * px + r11 * py + r12 * pz)
            z = cz - (r20 * px + r21 * py + r22 * pz)
            # The closed form every 5 ms, the Jacobian in between: nanometres apart, at a third of the time.
            if index % jacobian_every == 0:
                to_joints = np.asarray(np.linalg.pinv(self._arm.jacobian(joints, self._pose_flange_peg)), dtype=float)
            if index % exact_every == 0:
                try:
                    following = solve.follow(Pose(matrix_of(rotation), np.array((x, y, z))) @ peg_to_flange, joints)
                except InverseError as error:
                    return MotionEnding(StopReason.STALLED, f"yielding led out of reach: {error}")
                step = following - joints
            else:
                step = to_joints @ np.array(
                    (x - before_x, y - before_y, z - before_z, wx * period_s, wy * period_s, wz * period_s)
                )
                following = joints + step
            tip_m_s = abs(speed) + sqrt(vx * vx + vy * vy + vz * vz)
            reading: CycleReading = yield Reference(following, step / period_s, rotation, tip_speed_m_s=tip_m_s)
            joints = following
            wrench = [was + smoothing * (felt - was) for was, felt in zip(wrench, reading.contact, strict=True)]
            self.travel_m = (cx - bx) * dx + (cy - by) * dy + (cz - bz) * dz
            if self.travel_m >= command.travel_m:
                return MotionEnding(StopReason.SEATED)
            if (
                not search.steps
                and len(progress) == window
                and (self.travel_m - progress[0] < STALL_SHARE * command.speed_m_s * command.stall_s)
            ):
                return MotionEnding(
                    StopReason.STALLED,
                    f"advanced {(self.travel_m - progress[0]) * 1e3:.2f} mm in the last {command.stall_s:g} s, "
                    f"{self.travel_m * 1e3:.2f} of {command.travel_m * 1e3:.2f} mm in all",
                )
            progress.append(self.travel_m)
        return MotionEnding(StopReason.TIMED_OUT, f"{self.travel_m * 1e3:.2f} mm in {command.timeout_s:g} s")
