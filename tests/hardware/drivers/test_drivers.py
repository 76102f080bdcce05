"""Drivers by name, or by the path of the user's own."""

from __future__ import annotations

from pathlib import Path

import pytest

from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.config import CellFile, Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.keys import EVENTS
from crosspih_common.messages import Dwell, Event, GuardedMove, SetPayload
from crosspih_common.service import ServiceContext
from services.hardware.config import DEVICES, HardwareConfig
from services.hardware.control.config import STRICT_LANDING, LimitsConfig
from services.hardware.drivers.registry import DRIVERS
from services.hardware.hosting import open_cell
from services.hardware.protocols import Landing
from services.hardware.shells.hardware import HardwareShell

WALL = frozenset({"arm", "force_torque"})


@pytest.mark.parametrize("driver", ["simulated", DRIVERS["simulated"].target])
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
        (
            "ur10",
            "no driver 'ur10'; want ati, genicam, pictures, recorded, robotiq, ros2, simulated, ur, video, or your own",
        ),
        ("nowhere.to.be:found", "cannot be loaded"),
        ("services.hardware.drivers:no_such", "cannot be loaded"),
    ],
)
def test_a_driver_that_is_not_there_is_named(driver: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        open_cell(Workcell(), HardwareConfig(driver=driver), realtime=False)


def test_how_hard_it_lands_is_of_the_file_before_the_driver_and_strict_where_neither_says() -> None:
    declared = Landing(moved_mass_kg=7.3, contact_stiffness_n_m=7.3e6)
    assert LimitsConfig().landing(declared) == (declared, ())
    assert LimitsConfig(moved_mass_kg=9.0).landing(declared) == (Landing(9.0, 7.3e6), ())
    assert LimitsConfig().landing(None) == (STRICT_LANDING, ("moved_mass_kg", "contact_stiffness_n_m"))
    half = LimitsConfig(moved_mass_kg=9.0).landing(None)
    assert half == (Landing(9.0, STRICT_LANDING.contact_stiffness_n_m), ("contact_stiffness_n_m",))


@pytest.mark.parametrize(("driver", "strict"), [("simulated", False), ("docs.examples.spring_wall:open_devices", True)])
def test_an_arm_that_says_nothing_of_its_landing_is_slow_and_is_told_which_setting_is_missing(
    driver: str, strict: bool
) -> None:
    bus = Bus(MemoryHub().transport(), "cell1", "hardware")
    events: list[Event] = []
    bus.subscribe_inline(EVENTS, events.append)
    cell = open_cell(Workcell(), HardwareConfig(driver=driver), False, WALL if strict else frozenset(DEVICES))
    shell = HardwareShell(cell, ServiceContext("hardware", CellFile(Path("cell.yaml"), "", Workcell(), {}), bus))
    try:
        load = cell.arm.dwell(Dwell(duration_s=0.1)).wrench_raw
        cell.arm.set_payload(
            SetPayload(bias=load, weight_n=0.0, centroid_ft_m=(0.0, 0.0, 0.0), gravity_base=(0.0, 0.0, -1.0))
        )
        up = GuardedMove(direction_base=(0.0, 0.0, 1.0), speed_m_s=0.0075, travel_limit_m=0.001)
        notes = cell.arm.guarded_move(up).notes
    finally:
        shell.close()
        bus.close()
    if not strict:
        assert notes == () and events == []
        return
    assert "speed_m_s slowed from 0.0075 to 0.001095" in notes[0]
    assert [event.code for event in events] == ["strict_default"] * 2
    for event, name in zip(events, ("moved_mass_kg", "contact_stiffness_n_m"), strict=True):
        assert event.severity.value == "warning" and event.text.startswith(f"hardware.limits.{name}: not given")
