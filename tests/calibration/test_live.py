"""One push in the simulated cell, from home and back: what the arm does, what it takes down, and what its recording
says of it."""

from __future__ import annotations

import io
from functools import partialmethod
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from crosspih_common.calibration.presses import held, wrench_base
from crosspih_common.geometry import Pose
from crosspih_common.keys import FT_CALIBRATION, TRUTH
from crosspih_common.messages import FtCalibration
from crosspih_common.recording.comparing import differences
from services.force_torque.offline import answer
from services.operator.calibrate.moving import HeldArm
from services.operator.calibrate.options import recorded
from services.operator.calibrate.pressing import PressingManner, take_presses
from services.operator.calibrate.recorded import pressed_of, readings_of
from tests.calibration.cell_in_memory import CalibratedCell


@pytest.mark.timeout(900)
def test_a_push_finds_the_plate_presses_gently_and_goes_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # from place to place in free air five times as fast: two thirds of the steps were made there
    monkeypatch.setattr(HeldArm, "slide", partialmethod(HeldArm.slide, speed_m_s=0.1, turn_rad_s=1.5))
    # a plate that is known to 4 mm, so that what is slow, touching it, need not be looked for over 60 mm
    cell = CalibratedCell(tmp_path, {
        "cell": {"name": "cal", "hole_prior": {"half_range_depth_m": 0.004}},
        "hardware": {"simulated": {"seed": 3, "speed": "max"}},
    })  # fmt: skip
    try:
        truth = cell.bus.latest(TRUTH)
        session, console = cell.session(), Console(file=io.StringIO(), width=400)
        with recorded(session, "test", True, console):
            pressed = take_presses(session, console, PressingManner(1, 8.0), 1.0, "test", weighed=False)
        sensor = cell.bus.latest(FT_CALIBRATION).wait_for(lambda _: True, 10.0)
        told = truth.value()
    finally:
        cell.close()
    (path,) = (tmp_path / "recordings").iterdir()
    assert f"recording: {path}" in console.file.getvalue()  # type: ignore[attr-defined]
    again, notes = pressed_of(path, cell.cell.workcell)
    assert again.model_copy(update={"taken_at": pressed.taken_at}) == pressed and notes == []
    asked, _ = readings_of(path, cell.cell.workcell)
    (tmp_path / "readings.json").write_text(asked.model_dump_json(), encoding="utf-8")
    found = FtCalibration.model_validate(answer(tmp_path / "readings.json", cell.cell.path, None)["found"])
    assert sensor is not None and differences(sensor, found, frozenset({"date", "file"})) == []
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
