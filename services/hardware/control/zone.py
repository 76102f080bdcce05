"""Where the peg may meet the fixture: in front of the plate, wherever the cell's drawing lets the hole be.

The zone is that of `crosspih_common.collision.Fixture`, with which free ways are checked as well.
"""

from __future__ import annotations

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.collision import Fixture
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from services.hardware.control.pace import Pace, slowed
from services.hardware.control.paths import JointPath, LineInTime

_NODE_M = 1e-3
_NODE_S = 0.005
_MAX_NODES = 300
_OUTWARD = -0.9  # cosine against the peg's axis: straight back


class ContactZone:
    """The zone and the points of the peg that may meet it."""

    def __init__(self, workcell: Workcell, arm: ArmModel) -> None:
        self._arm = arm
        self._pose_flange_peg = workcell.pose_flange_peg()
        self._fixture, peg = Fixture.of(workcell), workcell.peg.shape()
        self._points_peg_m = np.vstack(
            [peg.outline_m(height) for height in (peg.body_start_m, peg.taper_start_m, peg.tip_m)]
        )

    def pace(
        self, path: JointPath | LineInTime, contact_m_s: float, braking_m_s2: float, clear_out_m_s: float
    ) -> tuple[Pace, str]:
        """The pace at which a path keeps the contact speed in the zone and can slow down to it before; and a note.

        Straight back along its own axis the peg may go at `clear_out_m_s`.
        """
        count = int(np.clip(np.ceil(path.duration_s / _NODE_S), 8, _MAX_NODES))
        times = np.linspace(0.0, path.duration_s, count + 1)
        poses = [self._arm.pose_base_flange(joints) @ self._pose_flange_peg for joints in path.positions(times)]
        points = np.array([pose.apply(self._points_peg_m) for pose in poses])
        moved = np.diff(points, axis=0)
        speeds = np.linalg.norm(moved, axis=2).max(axis=1) * (count / path.duration_s)
        speed = np.maximum(np.append(speeds, speeds[-1]), np.insert(speeds, 0, speeds[0]))
        near = self._fixture.distances_m(points).min(axis=1)
        allowed = np.sqrt(contact_m_s**2 + 2.0 * braking_m_s2 * near)
        axis = np.array([pose.rotation[:, 2] for pose in poses])[:-1]
        straight = moved.mean(axis=1)
        length = np.maximum(np.linalg.norm(straight, axis=1), 1e-12)
        outward = np.einsum("ij,ij->i", straight, axis) < _OUTWARD * length
        outward = np.append(outward, outward[-1]) & np.insert(outward, 0, outward[0])
        allowed = np.where(outward, np.maximum(allowed, clear_out_m_s), allowed)
        pace = slowed(times, speed, allowed, near < _NODE_M)
        if not pace.slows:
            return pace, ""
        fastest = float(np.max(speed[pace.rates < 1.0]))
        return pace, f"slowed near the fixture, from {fastest:.3g} to {contact_m_s:.3g} m/s where it may touch"


def tip_pose(workcell: Workcell) -> Pose:
    """`pose_flange_tip`: the peg frame moved to the tip."""
    return workcell.pose_flange_peg() @ Pose.from_translation([0.0, 0.0, workcell.peg.shape().tip_m])
