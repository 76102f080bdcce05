"""The life of a service as a process: status, clean end, and one clear line when it cannot start."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from crosspih_common.bus import Bus, MemoryHub, open_zenoh
from crosspih_common.config import load_cell
from crosspih_common.errors import CONFIG_STATUS, BusError
from crosspih_common.keys import FT_CALIBRATION, LOCATE, STATUS
from crosspih_common.messages import LocateHole, ServiceState, ServiceStatus
from crosspih_common.messages.status import LAST_ERROR_S
from crosspih_common.service import ServiceContext
from tests.conftest import ROOT, ServiceProcess

DEADLINE_S = 20.0
Spawn = Callable[..., ServiceProcess]


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    file = tmp_path / "cell.yaml"
    file.write_text(f"cell: {{name: life}}\nforce_torque: {{calibration_file: {tmp_path}/ft.yaml}}\n")
    return file


@pytest.fixture
def operator(endpoint: str) -> Iterator[Bus]:
    with Bus(open_zenoh(endpoint), "life", "operator") as bus:
        yield bus


class Statuses:
    """The states that a service went through, in order."""

    def __init__(self, bus: Bus) -> None:
        self.seen: list[ServiceStatus] = []
        self._changed = threading.Condition()
        bus.subscribe(STATUS, self._take)

    def _take(self, status: ServiceStatus) -> None:
        with self._changed:
            self.seen.append(status)
            self._changed.notify_all()

    def wait_for(self, state: ServiceState) -> ServiceStatus:
        until = time.monotonic() + DEADLINE_S
        with self._changed:
            while True:
                for status in self.seen:
                    if status.state is state:
                        return status
                left = until - time.monotonic()
                assert left > 0.0, f"never {state.value}; seen {[status.state.value for status in self.seen]}"
                self._changed.wait(left)


def test_a_service_is_ready_says_so_and_ends_cleanly(
    spawn: Spawn, endpoint: str, operator: Bus, cell_file: Path
) -> None:
    statuses = Statuses(operator)
    alive: list[tuple[str, bool]] = []
    operator.watch_alive(lambda service, here: alive.append((service, here)))
    calibration = operator.latest(FT_CALIBRATION)
    service = spawn("force_torque", "--cell", str(cell_file), "--endpoint", endpoint)
    ready = statuses.wait_for(ServiceState.READY)
    assert ready.service == "force_torque" and ready.pid == service.process.pid
    known = calibration.wait_for(lambda _: True, DEADLINE_S)
    assert known is not None and not known.calibrated
    assert service.terminate() == 0
    statuses.wait_for(ServiceState.STOPPING)
    assert alive[0] == ("force_torque", True) and alive[-1] == ("force_torque", False)


def test_a_device_that_cannot_open_fails_with_the_reason(
    spawn: Spawn, endpoint: str, operator: Bus, tmp_path: Path
) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text("cell: {name: life}\nhardware: {driver: ur10}\n")
    statuses = Statuses(operator)
    service = spawn("hardware", "--cell", str(file), "--endpoint", endpoint)
    failed = statuses.wait_for(ServiceState.FAILED)
    assert "hardware.driver: no driver 'ur10'" in failed.reason
    assert service.process.wait(DEADLINE_S) == 1


LANE_THAT_DIES = """
import sys
from crosspih_common.config import Section
from crosspih_common.keys import LOCATE
from crosspih_common.service import run_service
from crosspih_common.service.ending import end_process
def dies(request): raise SystemExit
def build(context, config): context.bus.serve(LOCATE, dies)
end_process(run_service("vision", Section, build, sys.argv[1:]))
"""


def test_a_service_whose_lane_died_says_so_and_ends_to_be_started_again(
    endpoint: str, operator: Bus, cell_file: Path
) -> None:
    statuses = Statuses(operator)
    command = [sys.executable, "-c", LANE_THAT_DIES, "--cell", str(cell_file), "--endpoint", endpoint]
    with subprocess.Popen(command, cwd=ROOT) as service:
        try:
            statuses.wait_for(ServiceState.READY)
            with pytest.raises(BusError):
                operator.call(LOCATE, LocateHole(), DEADLINE_S)
            failed = statuses.wait_for(ServiceState.FAILED)
            assert "vision:work has died" in failed.reason and failed.last_error_age_s is not None
            assert service.wait(DEADLINE_S) == 1
        finally:
            service.kill()


def test_the_last_error_is_old_after_a_while_and_then_none(cell_file: Path) -> None:
    with Bus(MemoryHub().transport(), "life", "vision") as bus:
        context = ServiceContext("vision", load_cell(cell_file), bus)
        assert context.status().last_error_age_s is None
        context.last_error = "lens: dirty"
        status = context.status()
        assert status.last_error == "lens: dirty"
        assert status.last_error_age_s is not None and status.last_error_age_s < LAST_ERROR_S
        context._last_error = (context._last_error[0] - LAST_ERROR_S - 1.0, "lens: dirty")
        assert (context.status().last_error, context.status().last_error_age_s) == ("", None)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cell: {nmae: life}", "cell.nmae: no such setting; remove it or mend its spelling"),
        ("cell: {name: life}\nforce_torque: {filter_hz: -1}", "force_torque.filter_hz"),
    ],
)
def test_a_wrong_setting_is_one_clear_line(spawn: Spawn, endpoint: str, tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    service = spawn("force_torque", "--cell", str(file), "--endpoint", endpoint)
    assert service.process.wait(DEADLINE_S) == CONFIG_STATUS
    service.terminate()
    output = "".join(service.output)
    assert words in output
    assert "Traceback" not in output
