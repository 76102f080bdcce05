"""Drivers by name, or by the path of the user's own."""

from __future__ import annotations

import pytest

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import DRIVERS
from services.hardware.hosting import open_cell


@pytest.mark.parametrize("driver", ["simulated", DRIVERS["simulated"]])
def test_a_driver_opens_by_name_and_by_path(driver: str) -> None:
    cell = open_cell(Workcell(), HardwareConfig(driver=driver), realtime=False)
    try:
        assert cell.arm.joint_state().joints_rad == pytest.approx(Workcell().home_joints_rad)
        assert cell.has_camera and cell.has_simulation
    finally:
        cell.close()


@pytest.mark.parametrize(
    ("driver", "words"),
    [
        ("ur10", "no driver 'ur10'; want recorded, simulated, or your own"),
        ("nowhere.to.be:found", "cannot be loaded"),
        ("services.hardware.drivers:no_such", "cannot be loaded"),
    ],
)
def test_a_driver_that_is_not_there_is_named(driver: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        open_cell(Workcell(), HardwareConfig(driver=driver), realtime=False)
