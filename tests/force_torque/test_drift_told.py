"""A drift is told once: not at every crossing of its limit, and again after it had gone."""

from __future__ import annotations

import numpy as np

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import load_cell
from crosspih_common.geometry import Pose
from crosspih_common.messages import JointState, RawWrenchBatch, floats
from crosspih_common.wrench import Payload
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.stream import WrenchStream


def test_what_the_bore_is_felt_by_is_no_drift() -> None:
    """A peg that slides in touches more lightly than is noticed as contact, for seconds."""
    workcell, config = load_cell("deploy/cells/default.yaml").workcell, ForceTorqueConfig()
    tip = Pose.from_translation([0.0, 0.0, workcell.peg.shape().tip_m])

    def told_at(depth_m: float) -> bool:
        stream = WrenchStream(workcell, config, Judge(workcell, config.contact_classifier))
        stream.use(Payload(np.zeros(6), np.zeros(3), np.zeros(3)), 0)
        pose_base_tip = workcell.hole_prior.pose_base_hole() @ Pose.from_translation([0.0, 0.0, depth_m])
        pose_base_flange = pose_base_tip @ tip.inverse() @ workcell.pose_flange_peg().inverse()
        joints_rad = floats(nearest(workcell.arm(), pose_base_flange, workcell.home_joints_rad))
        sample = (0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * config.drift_moment_nm)
        for stamp_ns in range(0, 3_000_000_000, 10_000_000):
            state = JointState(stamp_ns=stamp_ns, joints_rad=joints_rad, speeds_rad_s=(0.0,) * 6)
            batch = RawWrenchBatch(stamp_ns=stamp_ns, period_ns=1_000_000, samples=(sample,) * 10)
            if stream.take(batch, [state]).drift:
                return True
        return False

    assert told_at(-0.05) and not told_at(0.01)


def test_a_drift_that_lies_on_its_limit_is_told_once() -> None:
    workcell, config = load_cell("deploy/cells/default.yaml").workcell, ForceTorqueConfig()
    stream = WrenchStream(workcell, config, Judge(workcell, config.contact_classifier))
    stream.use(Payload(np.zeros(6), np.zeros(3), np.zeros(3)), 0)
    stamp_ns, told = 0, []
    limit = config.drift_moment_nm
    for level in (1.1, 0.95, 1.1, 0.95, 1.1, 0.3, 1.1):
        count = 0
        for _ in range(300):
            home = JointState(stamp_ns=stamp_ns, joints_rad=workcell.home_joints_rad, speeds_rad_s=(0.0,) * 6)
            sample = (0.0, 0.0, 0.0, 0.0, 0.0, level * limit)
            batch = RawWrenchBatch(stamp_ns=stamp_ns, period_ns=1_000_000, samples=(sample,) * 10)
            count += bool(stream.take(batch, [home]).drift)
            stamp_ns += 10_000_000
        told.append(count)
    assert told == [1, 0, 0, 0, 0, 0, 1]
