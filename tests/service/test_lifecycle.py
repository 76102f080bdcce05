"""The life of a service as a process: status, clean end, and one clear line when it cannot start."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.keys import FT_CALIBRATION, STATUS
from crosspih_common.messages import ServiceState, ServiceStatus
from tests.conftest import ServiceProcess

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
    assert service.process.wait(DEADLINE_S) == 1
    service.terminate()
    output = "".join(service.output)
    assert words in output
    assert "Traceback" not in output
