"""The refined cell's file: the settings are in, and a simulated cell is still the machine that it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from crosspih_common.config import Workcell
from services.operator.calibrate.refined_cell import refined_content, refined_table
from services.operator.cli.commands import app

TRUTH = {"taper_slope_factor": 1.01, "clearance_offset_m": 5e-5, "ft_shift_m": [1e-4, 0.0, 0.0]}
BASE: dict[str, Any] = {"cell": {"name": "cell1"}, "hardware": {"simulated": {"truth": TRUTH}}}


def test_the_simulated_machine_stays_what_it_was() -> None:
    slope = Workcell().peg.taper_slope
    peg = Workcell().peg.shape()
    apex_m = peg.taper_start_m + (peg.apex_m - peg.taper_start_m) / 1.006
    tip = {"taper_slope": 1.006 * slope, "apex_m": apex_m, "tip_half_width_m": 1.006 * slope * (apex_m - peg.tip_m)}
    content = refined_content(BASE, {"cell": {"peg": tip, "hole": {"clearance_m": 0.00014}}})
    truth = content["hardware"]["simulated"]["truth"]
    workcell = Workcell.model_validate(content["cell"])
    assert workcell.hole.clearance_m + truth["clearance_offset_m"] == pytest.approx(0.00015)
    assert workcell.peg.taper_slope * truth["taper_slope_factor"] == pytest.approx(1.01 * slope)
    assert truth["ft_shift_m"] == TRUTH["ft_shift_m"]
    assert content["cell"]["name"] == "cell1"
    assert BASE["hardware"]["simulated"]["truth"]["clearance_offset_m"] == 5e-5


def test_a_real_cell_gets_no_truth() -> None:
    content = refined_content({"hardware": {"driver": "mine"}}, {"cell": {"hole": {"clearance_m": 0.00012}}})
    assert content == {"hardware": {"driver": "mine"}, "cell": {"hole": {"clearance_m": 0.00012}}}


def test_the_sensors_correction_goes_where_arm_and_service_read_it() -> None:
    base = {
        "hardware": {"driver": "mine"},
        "force_torque": {"filter_hz": 40.0, "sensor_correction": {"shift_m": [0.001, 0.0, 0.0]}},
    }
    found = {"shift_m": [0.0005, 0.0, 0.0], "turn_rad": [0.0, 0.01, 0.0]}
    content = refined_content(base, {"cell": {"force_torque": {"correction": found}}})
    assert content == {
        "hardware": {"driver": "mine"},
        "force_torque": {"filter_hz": 40.0},
        "cell": {"force_torque": {"correction": found}},
    }


def test_the_table_says_what_was_kept() -> None:
    one = {"name": "taper", "before": 0.0, "found": 0.004, "sd": 0.009, "prior_sd": 0.01, "taken": False, "value": 0.0}
    counts = dict.fromkeys(("assemblies", "touches", "presses", "seen", "calibrations"), 1)
    table = refined_table({**counts, "parameters": [one]})
    assert list(table.columns[-1].cells) == ["as it was"]


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "not.mcap"
    path.write_text("no recording")
    result = CliRunner().invoke(app, ["calibrate", "refine", str(path), "--cell", "deploy/cells/default.yaml"])
    assert result.exit_code == 1
    assert "no MCAP file" in result.output
