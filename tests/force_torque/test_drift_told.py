"""A drift is told once: not at every crossing of its limit, and again after it had gone."""

from __future__ import annotations

import numpy as np

from crosspih_common.config import load_cell
from crosspih_common.messages import JointState, RawWrenchBatch
from crosspih_common.wrench import Payload
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.stream import WrenchStream


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
