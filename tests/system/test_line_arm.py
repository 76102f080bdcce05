"""The example driver over TCP, before a controller in a process of its own that goes away and comes back."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from crosspih_common.config import cell_of_text
from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.messages import Dwell, StopReason
from docs.examples import line_arm
from services.hardware.checking import check_devices
from services.hardware.config import HardwareConfig
from services.hardware.hosting import open_cell
from tests.system.running_cell import wait_until

ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "docs" / "examples" / "line-arm.yaml"
ARM = frozenset({"arm", "force_torque"})


class Controller:
    """The other end."""

    def __init__(self) -> None:
        self.port = 0
        self.start()

    def start(self) -> None:
        """On the same port as before."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "docs.examples.line_peer", str(self.port)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline().split()[-1])

    def kill(self) -> None:
        """At once."""
        assert self._process.stdout is not None
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()


@pytest.fixture
def controller() -> Iterator[Controller]:
    there = Controller()
    yield there
    there.kill()


def test_the_arm_is_read_lost_and_found_again(controller: Controller) -> None:
    cell = cell_of_text(CELL, CELL.read_text().replace("5757", str(controller.port)))
    rows = {row["name"]: row for row in check_devices(cell, None, True)}
    assert {row["verdict"] for row in rows.values()} == {"ok"}, rows
    assert "6 joints inside their limits" in rows["device arm"]["found"]
    config = cell.section("hardware", HardwareConfig)
    patient = config.model_copy(update={"limits": config.limits.model_copy(update={"missed_cycles": 10_000})})
    hosted = open_cell(cell.workcell, patient, realtime=True, wanted=ARM)
    dwell = Dwell(duration_s=0.1)
    try:
        assert hosted.arm.dwell(dwell).stop_reason is StopReason.COMPLETED
        controller.kill()

        def lost() -> bool:
            try:
                hosted.arm.dwell(dwell)
            except CommandRefused as refusal:
                return refusal.code == "device_lost"
            return False

        wait_until(lost, "the arm is told to be away")
        controller.start()
        wait_until(lambda: not lost(), "the arm is back")
        assert hosted.arm.dwell(dwell).stop_reason is StopReason.COMPLETED
    finally:
        hosted.close()


def test_who_is_not_there_or_is_another_arm_is_named(controller: Controller) -> None:
    text = CELL.read_text().replace("5757", str(controller.port))
    panda = cell_of_text(CELL, text.replace("name: lines1", "name: lines1\n  arm: {name: panda}"))
    with pytest.raises(ConfigError, match=r"cell\.arm has 7 joints, the controller 6: name the right arm"):
        open_cell(panda.workcell, panda.section("hardware", HardwareConfig), True, ARM)
    controller.kill()
    cell = cell_of_text(CELL, text)
    with pytest.raises(ConfigError, match=r"hardware\.options\.host: nobody answers at 127.0.0.1"):
        open_cell(cell.workcell, cell.section("hardware", HardwareConfig), True, ARM)
    controller.start()


def test_the_driver_is_thin() -> None:
    assert len(Path(line_arm.__file__).read_text(encoding="utf-8").splitlines()) <= 110
