"""The doctor's rows of the cell's file: calibrations, and drawings against what the arm reaches and cameras see."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from crosspih_common.config import Workcell
from crosspih_common.messages import (
    CameraCalibration,
    CameraModel,
    PoseData,
    Strategy,
)
from services.force_torque.calibration_file import CalibrationFile, save_calibration
from services.operator.cli.rows import Verdict
from services.operator.doctor import (
    calibrations,
    devices,
    drawing,
)
from services.operator.doctor.weights import weight_rows
from tests.operator.doctor.doctor_rows import NOW, cell_of, every_bad_row_has_a_mend, verdicts

# --------------------------------------------------------------------------------------------------------- calibrations


def calibration(made: datetime, **fields: Any) -> CalibrationFile:
    return CalibrationFile.model_validate(
        {
            "calibrated_at": made.isoformat(), "cell": "cell1", "bias": [0.0] * 6, "bias_sd": [0.0] * 6,
            "weight_base_n": [0.0, 0.0, -9.5], "weight_n": 9.5, "weight_sd_n": 0.01, "base_tilt_rad": 0.0,
            "centroid_sensor_m": [0.0, 0.0, 0.03], "force_rms_n": 0.01, "moment_rms_nm": 0.001,
            "condition_force": 2.0, "condition_moment": 2.0, "poses": [],
            "peg_of_raw": np.asarray(Workcell().sensor_mounting().peg_of_raw).ravel().tolist(), **fields,
        }
    )  # fmt: skip


@pytest.mark.parametrize(
    ("days", "fields", "now_c", "verdict", "words"),
    [
        (2, {"temperature_c": 21.0}, 22.0, "ok", "2 days old, at 21 °C"),
        (0, {}, 22.0, "ok", "temperature not told"),
        (2, {"temperature_c": 21.0}, 35.0, "warning", "it is 35 °C now"),
        (90, {}, None, "warning", "90 days old"),
        (-3, {}, None, "warning", "3 days ahead"),
        (1, {"cell": "another"}, None, "warning", "is of the cell another"),
        (1, {"peg_of_raw": np.diag([-1.0] * 6).ravel().tolist()}, None, "warning", "another mounting"),
    ],
)
def test_a_calibration_of_the_sensor_is_judged_by_age_temperature_and_mounting(
    tmp_path: Path, days: float, fields: dict[str, Any], now_c: float | None, verdict: str, words: str
) -> None:
    file = tmp_path / "ft.yaml"
    save_calibration(calibration(NOW - timedelta(days=days), **fields), file)
    cell = cell_of(f"force_torque: {{calibration_file: '{file}'}}")
    rows = list(calibrations.ft_rows(cell, NOW, now_c))
    assert [row.verdict.value for row in rows] == [verdict] and words in rows[0].found
    assert every_bad_row_has_a_mend(rows)


def test_a_calibration_that_is_not_there_or_is_none_is_told_and_others_beside_it_are_aged(tmp_path: Path) -> None:
    file = tmp_path / "ft.yaml"
    cell = cell_of(f"force_torque: {{calibration_file: '{file}'}}")
    assert verdicts(calibrations.ft_rows(cell, NOW, None)) == {"calibration of the sensor": "warning"}
    file.write_text("not: a calibration")
    assert verdicts(calibrations.ft_rows(cell, NOW, None)) == {"calibration of the sensor": "wrong"}
    for folder, kind, made in (
        ("a", "hand-eye", "2026-02-27T00:00:00Z"), ("b", "stereo", "2024-02-27T00:00:00+00:00"),
        ("c", "hand-eye", "2024-01-01T00:00:00Z"), ("d", "", "2026-02-27T00:00:00Z"),
    ):  # fmt: skip
        found = tmp_path / "cell1" / "calibration" / folder / "found.yaml"
        found.parent.mkdir(parents=True)
        found.write_text(yaml.safe_dump({"kind": kind and f"calibration of {kind}", "calibrated_at": made}))
    assert verdicts(calibrations.other_rows(cell, NOW, None, tmp_path)) == {
        "calibration of hand-eye": "ok", "calibration of stereo": "warning",
    }  # fmt: skip


def test_cameras_that_were_never_calibrated_are_told(tmp_path: Path) -> None:
    def judged(text: str) -> str:
        cell = cell_of(text)
        return next(calibrations.camera_rows(cell, devices.drivers_of(cell))).verdict.value

    (tmp_path / "cameras.yaml").write_text("left: {}")
    assert judged("cell: {name: cell1}") == "ok"
    assert judged("hardware: {drivers: {camera: video}}") == "warning"
    assert judged("cell: {camera: {fx_px: 900}}\nhardware: {drivers: {camera: video}}") == "ok"
    assert judged("hardware: {drivers: {camera: pictures}}") == "wrong"
    pictures = f"hardware: {{drivers: {{camera: pictures}}, pictures: {{calibration: '{tmp_path / 'cameras.yaml'}'}}}}"
    assert judged(pictures) == "ok"


# ------------------------------------------------------------------------------------------------------------- drawings


def workcell(**fields: Any) -> Workcell:
    return Workcell.model_validate(fields)


def prior(x: float = 0.4, **fields: float) -> dict[str, Any]:
    return {"matrix_base_hole": [[-0.07, 0.06, 1.0, x], [-0.06, -1.0, 0.06, -0.3], [1.0, -0.06, 0.07, 0.2]], **fields}


@pytest.mark.parametrize(
    ("fields", "bad"),
    [
        ({}, {}),
        ({"hole": {"clearance_m": 2e-5}}, {"peg in hole": "wrong"}),
        ({"hole": {"clearance_m": 5e-5}}, {"peg in hole": "warning"}),
        ({"insertion_depth_m": 0.06}, {"insertion depth": "wrong"}),
    ],
)
def test_peg_and_hole_fit_by_their_drawings(fields: dict[str, Any], bad: dict[str, str]) -> None:
    assert verdicts(drawing.fit_rows(workcell(**fields))) == {"peg in hole": "ok", "insertion depth": "ok", **bad}


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, {"reach": "ok", "joints at the hole": "ok"}),
        ({"hole_prior": prior(1.5)}, {"reach": "wrong"}),
        ({"hole_prior": prior(half_range_lateral_m=0.4)}, {"reach": "warning"}),
    ],
)
def test_the_arm_reaches_wherever_the_hole_may_be(fields: dict[str, Any], expected: dict[str, str]) -> None:
    found = verdicts(drawing.reach_rows(workcell(**fields)))
    assert expected.items() <= found.items()


def test_a_joint_near_its_limit_at_the_hole_is_named() -> None:
    sound = next(row for row in drawing.reach_rows(workcell()) if row.name == "joints at the hole")
    joint = int(sound.found.split()[1])
    least = float(sound.found.split("within ")[1].split()[0])
    arm = workcell().arm()
    upper = np.array(arm.limits.upper_rad)
    lower = np.array(arm.limits.lower_rad)
    # the same arm, its ranges narrower by what was left: on both sides, for which of them is near is not told
    upper[joint - 1] -= least - 0.02
    lower[joint - 1] += least - 0.02
    narrow = workcell(arm={"name": "xb4", "upper_rad": upper.tolist(), "lower_rad": lower.tolist()})
    row = next(row for row in drawing.reach_rows(narrow) if row.name == "joints at the hole")
    assert row.verdict is Verdict.WARNING and f"joint {joint} comes within 0.0" in row.found


@pytest.mark.parametrize(
    ("camera", "verdict"),
    [
        ({}, "ok"),
        ({"matrix_base_camera": [[0, 0, -1, 0.131], [-1, 0, 0, -0.24], [0, 1, 0, 0.22]]}, "wrong"),  # looks away
        ({"fx_px": 900.0, "fy_px": 900.0}, "warning"),  # a long lens: the corners are outside
        ({"fx_px": 100.0, "fy_px": 100.0}, "warning"),  # a short one: the hole is small
    ],
)
def test_cameras_see_the_hole_wherever_it_may_be(camera: dict[str, Any], verdict: str) -> None:
    rows = list(drawing.camera_rows(workcell(camera=camera), None))
    assert [row.verdict.value for row in rows] == [verdict] and every_bad_row_has_a_mend(rows)


def test_what_running_cameras_say_of_themselves_goes_before_the_file() -> None:
    model = CameraModel(width_px=640, height_px=480, fx_px=381.0, fy_px=381.0, cx_px=320.0, cy_px=240.0)
    away = PoseData(position_m=(0.13, -0.24, 0.22), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))  # straight up
    right = PoseData(position_m=(0.05, 0.0, 0.0), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    told = CameraCalibration(left=model, right=model, pose_left_right=right, pose_base_camera=away)
    assert verdicts(drawing.camera_rows(workcell(), told)) == {"cameras see the hole": "wrong"}


def test_networks_are_there_where_the_strategy_needs_them(tmp_path: Path) -> None:
    assert verdicts(weight_rows(Strategy.FUSED, {}, "no_such_torch")) == {"networks": "ok"}
    assert verdicts(weight_rows(Strategy.PAPER, {}, "no_such_torch")) == {"networks": "wrong"}
    pytest.importorskip("safetensors")
    assert verdicts(weight_rows(Strategy.SEQUENCE, {}, "json")) == {"networks": "ok"}  # any package that is there
    missing = {"weights": str(tmp_path / "none.safetensors")}
    assert verdicts(weight_rows(Strategy.PAPER, missing, "json")) == {"networks": "wrong"}
