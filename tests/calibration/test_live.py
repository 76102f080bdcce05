"""One push in the simulated cell, from home and back: what the arm does, and what it takes down."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from crosspih_common.calibration.presses import held, wrench_base
from crosspih_common.geometry import Pose
from crosspih_common.keys import TRUTH
from services.operator.calibrate.pressing import Manner, take_presses
from tests.calibration.cell_in_memory import CalibratedCell


@pytest.mark.timeout(900)
def test_a_push_finds_the_plate_presses_gently_and_goes_home(tmp_path: Path) -> None:
    cell = CalibratedCell(tmp_path, {"cell": {"name": "cal"}, "hardware": {"simulated": {"seed": 3, "speed": "max"}}})
    try:
        truth = cell.bus.latest(TRUTH)
        pressed = take_presses(cell.session(), Console(file=io.StringIO()), Manner(1, 8.0), 1.0, "test", weighed=False)
        told = truth.value()
    finally:
        cell.close()
    assert told is not None
    workcell = cell.cell.workcell
    hole: Pose = told.pose_base_hole.pose()
    normal = np.asarray(pressed.normal_base)
    assert float(np.linalg.norm(np.cross(normal, hole.rotation[:, 2]))) < np.deg2rad(0.05)
    levels = held(pressed.presses[0], workcell)
    felt = [-float(wrench_base(level, workcell)[:3] @ normal) for level in levels]
    assert len(felt) >= 2 and felt == sorted(felt) and felt[-1] == pytest.approx(8.0, abs=1.0)
    home = workcell.pose_base_peg(workcell.home_joints_rad)
    assert told.pose_base_peg.pose().distance_to_m(home) < 1e-3
