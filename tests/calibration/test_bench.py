"""The bench's own reckoning: the fits after each other, against a machine whose truth is known."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from crosspih_common.calibration.stiffness import fit_stiffness
from crosspih_common.calibration.tcp import fit_tip
from crosspih_common.config import CellFile
from crosspih_common.config.cell import cell_of_text
from services.operator.bench.calibrations.scored import hidden, pushes_scored
from services.operator.calibrate.settings import stiffness_settings, tcp_settings
from tests.calibration.synthetic_presses import WORKCELL, Machine, Rig

# the package names the command like its module
calibrations: Any = importlib.import_module("services.operator.bench.calibrations.command")
CONTENT: dict[str, Any] = {"cell": {"name": "bench"}}


def _cell(folder: Path, content: dict[str, Any]) -> CellFile:
    return cell_of_text(folder / "cell.yaml", yaml.safe_dump(content))


def _machine(seed: int) -> tuple[Machine, dict[str, Any]]:
    truth = hidden(seed, 6)["hardware"]["simulated"]["truth"]
    machine = Machine(
        factors=np.array(truth["joint_stiffness_factors"]), turn_rad=np.array(truth["ft_turn_rad"]),
        sensor_m=np.array(truth["ft_shift_m"]), peg_m=np.array(truth["peg_shift_m"]),
    )  # fmt: skip
    return machine, truth


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_tip_mounting_and_stiffness_are_told_against_the_truth(seed: int, tmp_path: Path) -> None:
    machine, truth = _machine(seed)
    pressed = Rig(machine, seed).pressed(weighings=10)

    rows = {row["name"]: row for row in pushes_scored(pressed, _cell(tmp_path, CONTENT), CONTENT, truth)}
    assert max(map(abs, rows["tcp, tip"]["off"])) < 0.02
    assert np.linalg.norm(rows["mount, place"]["off"]) < 0.2
    assert np.linalg.norm(rows["mount, turn"]["off"]) < 0.1
    assert max(map(abs, rows["stiffness"]["off"])) < 5.0
    assert rows["stiffness, joints left open"]["open"] == [6]
    table = calibrations.table_of({name: [row] for name, row in rows.items()})
    assert table.row_count == len(rows)


def test_a_simulated_cell_stays_the_machine_that_it_was(tmp_path: Path) -> None:
    machine, truth = _machine(4)
    pressed = Rig(machine, 4).pressed()
    content = {"cell": {"name": "bench"}, "hardware": {"simulated": {"truth": truth}}}
    cell = _cell(tmp_path, content)
    stiff = stiffness_settings(fit_stiffness(pressed, WORKCELL), cell)
    told = np.array(stiff["cell"]["joint_stiffness_nm_rad"])
    kept = np.array(stiff["hardware"]["simulated"]["truth"]["joint_stiffness_factors"])
    real = np.asarray(WORKCELL.joint_stiffness_nm_rad) * truth["joint_stiffness_factors"]
    assert told * kept == pytest.approx(real, rel=1e-6)
    tip = fit_tip(pressed, WORKCELL)
    moved = tcp_settings(tip, cell)
    peg = np.array(moved["cell"]["flange_to_ft"]["position_m"]) - WORKCELL.pose_flange_peg().translation_m
    assert peg + moved["hardware"]["simulated"]["truth"]["peg_shift_m"] == pytest.approx(truth["peg_shift_m"], abs=1e-8)
    # the sensor did not move on the flange
    assert moved["cell"]["force_torque"]["pose_flange_sensor"]["position_m"] == pytest.approx(
        WORKCELL.pose_flange_peg().translation_m.tolist()
    )
