"""`crosspih cell check` names each planted mistake with its mend, and finds nothing in a sound cell."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosspih_common.client.checked import FILE
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import CLOCK, DWELL
from crosspih_common.messages import Dwell
from services.operator.cell.check.first import check_before_first
from services.operator.cell.check.measuring import CheckManner, check_cell
from services.operator.cli.rows import Verdict, table_of, wrong_ones
from tests.operator.cell.mistaken_cells import (
    cell_with,
    deaf,
    gullible,
    obliging,
    speeds_in_degrees,
    speeds_left_out,
)

# as gentle, in less of the cell's time; nobody is waited for in memory
QUICK = CheckManner(turn_rad_s=1.0, dwell_s=0.15, settle_s=0.05, patience_s=0.1)
LEVEL = CheckManner(dwell_s=0.15, patience_s=0.1, tilting=False)
OF_THE_TILT = ("sensor's sign and axes", "unit of force", "joint speeds in rad/s")
TOLD = CheckManner(turn_rad_s=1.0, dwell_s=0.15, settle_s=0.05, patience_s=0.1, provoking=False)
RIGHT_ANGLE = float(np.pi / 2)

# what is planted; the check that must name it, what it must have found, and what must mend it
PLANTED: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "inverted sensor": (
        {"truth": {"ft_factors": [-1.0] * 6}},
        "sensor's sign and axes", "sign is reversed", "cell.force_torque.reports: reaction",
    ),
    "forces in mN": (
        {"truth": {"ft_factors": [1000.0] * 6}},
        "sensor within its range", "range is 300 N", "force_unit: mN",
    ),
    "forces in lbf": (
        {"truth": {"ft_factors": [1 / 4.4482216] * 6}, "cell": {"force_torque": {"weighed_n": 9.56}}},
        "unit of force", "the driver tells lbf", "cell.force_torque.force_unit: lbf",
    ),
    "turned on its mount": (
        {"truth": {"ft_turn_rad": [0.0, 0.0, RIGHT_ANGLE]}},
        "sensor's sign and axes", "turned by 90 degrees", "cell.force_torque.axes: [-y, x, z]",
    ),
    "joints in degrees": ({"driver": "in_degrees"}, "joints in rad, inside the limits", "degrees", "np.deg2rad"),
    "joint speeds in degrees a second": (
        {"arm": speeds_in_degrees}, "joint speeds in rad/s", "57.3 times", "np.deg2rad",
    ),
    "joint speeds left out": ({"arm": speeds_left_out}, "joint speeds in rad/s", "zero while", "give the speeds"),
    "sensor on the wall's clock": ({"driver": "wall_stamps"}, "stamps of ft/raw", "UNIX", "the arm's cycle"),
    "a period that is not the sensor's": (
        {"driver": "other_period"}, "period of ft/raw", "every 2 ms is declared, the stamps say 1 ms", "real period",
    ),
    "size against calibration": (
        {"driver": "half_size"}, "left image", "320 x 240, the calibration says 640 x 480", "calibrate at the size",
    ),
    "width and height exchanged": ({"driver": "half_size"}, "right image", "exchanged", "calibrate at the size"),
    "no tokens": ({"tokens": False}, "liveliness token of hardware", "not declared", "declare the token"),
    "no camera token": ({"tokens": False}, "liveliness token of camera", "not declared", "declare the token"),
    "stop not heeded": ({"arm": deaf}, "stop", "went on to its end", "hear arm/stop in every state"),
    "limits not refused": ({"arm": obliging}, "joint limit refused", "carried out", "before anything moves"),
    "any payload believed": (
        {"arm": gullible}, "payload that hides a load refused", "carried out", "hides 50 N from the caps",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., list[Any]]:
    """The checks of a cell; of one that was looked at already, those."""
    known: dict[str, list[Any]] = {}

    def look(planted: dict[str, Any], manner: CheckManner = QUICK) -> list[Any]:
        name = repr(planted)
        if name not in known:
            with cell_with(tmp_path_factory.mktemp("cell"), **planted) as (bus, cell):
                known[name] = check_cell(bus, cell.workcell, manner)
        return known[name]

    return look


def test_a_sound_cell_passes_all(found: Callable[..., list[Any]]) -> None:
    checks = found({})
    assert [check for check in checks if check.verdict is not Verdict.OK] == []
    assert len({check.name for check in checks}) >= 24


@pytest.mark.parametrize("mistake", PLANTED)
def test_each_planted_mistake_is_named_with_its_mend(found: Callable[..., list[Any]], mistake: str) -> None:
    planted, name, said, mend = PLANTED[mistake]
    wrong = {check.name: check for check in wrong_ones(found(planted, QUICK if name in OF_THE_TILT else LEVEL))}
    assert name in wrong, wrong
    assert said in wrong[name].found and mend in wrong[name].mend, wrong[name]
    # and nothing is blamed that is sound: the exception is what one mistake brings with it
    brought = {"left image", "right image", "liveliness token of hardware", "holding still"}
    assert set(wrong) - brought - {name, "liveliness token of camera"} == set(), wrong


def test_nothing_moves_where_the_joints_are_in_degrees(tmp_path: Path) -> None:
    with cell_with(tmp_path, "in_degrees") as (bus, cell):
        checks = check_cell(bus, cell.workcell, QUICK)
    assert "motion" in {check.name for check in checks if check.verdict is Verdict.SKIPPED}
    assert not {"stop", "joint limit refused", "sensor's sign and axes"} & {check.name for check in checks}


def test_the_cameras_alone_need_no_arm_to_hold(tmp_path: Path) -> None:
    with cell_with(tmp_path) as (bus, cell):
        checks = check_cell(bus, cell.workcell, CheckManner(arm=False, patience_s=0.1))
    assert [check.name for check in checks] == [
        "liveliness token of camera", "left image", "right image", "stereo pair", "messages as the contract says",
    ]  # fmt: skip
    assert not wrong_ones(checks)


def test_the_table_shows_found_and_mend(found: Callable[..., list[Any]]) -> None:
    checks = found(PLANTED["size against calibration"][0], LEVEL)
    table = table_of(checks, "mistaken")
    assert table.row_count == len(checks)
    assert [str(column.header) for column in table.columns] == ["check", "verdict", "found", "mend"]


def test_the_gentle_part_runs_once_a_boot(tmp_path: Path) -> None:
    with cell_with(tmp_path) as (bus, cell):
        assert check_before_first(bus, cell.workcell, "first", tmp_path, manner=TOLD)
        assert json.loads((tmp_path / FILE).read_text())["boot_id"] == "first"
        assert not check_before_first(bus, cell.workcell, "first", tmp_path, manner=TOLD)
        # the arm is left where it stood, and free for whoever comes next
        stands = bus.latest(CLOCK)
        assert stands.value() is not None
        with pytest.raises(CommandRefused) as refused:
            bus.call(DWELL, Dwell(duration_s=0.01), 5.0)
        assert refused.value.code == "no_lease"


def test_an_inverted_sensor_is_refused_before_the_first_assembly(tmp_path: Path) -> None:
    with cell_with(tmp_path, truth={"ft_factors": [-1.0] * 6}) as (bus, cell):
        with pytest.raises(CommandRefused, match=r"sign is reversed.*reports: reaction") as refused:
            check_before_first(bus, cell.workcell, "boot", tmp_path, manner=TOLD)
        assert refused.value.code == "cell_unfit"
        assert not (tmp_path / FILE).exists()
