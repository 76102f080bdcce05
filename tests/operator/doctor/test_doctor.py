"""The rows of the machine: software, network, clocks, disk, devices, each sound and broken by what is really so."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import load_cell
from crosspih_common.keys import CAMERA_CALIBRATION, CLOCK
from crosspih_common.messages import (
    CameraCalibration,
    CameraModel,
    CellClock,
    PoseData,
)
from services.hardware.control.config import LimitsConfig
from services.operator.cli.commands import app
from services.operator.cli.rows import Row, Verdict, looked
from services.operator.doctor import (
    addresses,
    clocks,
    devices,
    drawing,
    examination,
    machine,
    network,
    sections,
    software,
)
from services.planning.config import PlanningConfig
from tests.operator.doctor.doctor_rows import ROOT, every_bad_row_has_a_mend, verdicts


def test_what_the_doctor_knows_of_other_services_is_what_they_have() -> None:
    assert LimitsConfig().holder_timeout_s == examination.HOLDER_TIMEOUT_S
    assert PlanningConfig().approach_m == drawing.APPROACH_M
    assert set(sections.NEEDED) == set(examination.COMMANDS_NEED)


# ------------------------------------------------------------------------------------------------------------- software


def test_python_is_of_the_versions_that_are_tested() -> None:
    assert software.python_row().verdict is Verdict.OK
    assert software.python_row((3, 9, 18)).verdict is Verdict.WRONG
    assert software.python_row((3, 99, 0)).verdict is Verdict.WARNING


def test_packages_are_held_to_what_the_distribution_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "needy-1.0.dist-info"
    info.mkdir()
    needs = ["numpy>=2.0", "pydantic>=99", "no-such-package>=1; extra == 'vision'", "not-for-us; extra == 'render'"]
    (info / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: needy\nVersion: 1.0\n" + "".join(f"Requires-Dist: {need}\n" for need in needs)
    )
    monkeypatch.syspath_prepend(tmp_path)
    rows = list(software.package_rows("needy"))
    assert verdicts(rows) == {"package pydantic": "wrong", "package no-such-package": "wrong", "packages": "ok"}
    assert "needed by vision" in rows[1].found and "pip install 'no-such-package>=1'" in rows[1].mend
    assert verdicts(software.package_rows("nobody-has-this")) == {"packages": "warning"}


def test_a_wheel_that_does_not_load_and_one_that_ends_its_process_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "torn_wheel.py").write_text("raise ImportError('libmissing.so.3: cannot open shared object file')")
    (tmp_path / "deadly_wheel.py").write_text("import os; os._exit(7)")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    rows = list(software.wheel_rows(("numpy", "torn_wheel")))
    assert verdicts(rows) == {"wheel torn_wheel": "wrong"} and "libmissing.so.3" in rows[0].found
    ended = list(software.wheel_rows(("numpy", "deadly_wheel")))
    assert verdicts(ended) == {"wheels": "wrong"} and "loading deadly_wheel" in ended[0].found
    assert verdicts(software.wheel_rows(("numpy",))) == {"wheels": "ok"}


# -------------------------------------------------------------------------------------------------------------- network


@pytest.fixture
def listener() -> Iterator[int]:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        yield server.getsockname()[1]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_an_endpoint_is_free_or_taken_by_somebody_who_is_named(listener: int) -> None:
    rows, bus = network.router_rows(f"tcp/127.0.0.1:{free_port()}", "cell1")
    assert verdicts(rows) == {"router": "ok"} and bus is None and "is free" in rows[0].found
    rows, bus = network.router_rows(f"tcp/127.0.0.1:{listener}", "cell1")
    assert verdicts(rows) == {"router": "wrong"} and bus is None and "no Zenoh router" in rows[0].found
    if Path("/proc/net/tcp").exists():
        assert "taken by pid" in rows[0].found
    rows, _ = network.router_rows("127.0.0.1:7447", "cell1")
    assert verdicts(rows) == {"router": "wrong"} and "tcp/127.0.0.1:7447" in rows[0].mend
    rows, _ = network.router_rows(f"tcp/no-such-host.invalid:{free_port()}", "cell1")
    assert verdicts(rows) == {"router": "wrong"} and "start the router there" in rows[0].mend


def test_which_services_live_and_whether_one_cell_is_on_the_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "HEAR_S", 0.2)
    hub = MemoryHub()
    needed = ("hardware", "planning")
    with Bus(hub.transport(), "c", "hardware") as hardware, Bus(hub.transport(), "c", "operator") as bus:
        assert verdicts(network.service_rows(bus, set(), needed)) == {"services": "ok"}
        silent = list(network.service_rows(bus, {"hardware"}, needed))
        assert verdicts(silent) == {"services": "wrong", "one cell on its keys": "wrong"}
        assert (
            "planning not" in silent[0].found
            and "crosspih logs planning" in silent[0].mend
            and "does not tick" in silent[1].found
        )
        tick = CellClock(stamp_ns=1, boot_id="one", realtime=True, simulated=False)
        hardware.publisher(CLOCK).publish(tick)
        assert verdicts(network.service_rows(bus, set(needed), needed)) == {
            "services": "ok", "one cell on its keys": "ok",
        }  # fmt: skip
        quiet = threading.Event()

        def tick_twice() -> None:
            while not quiet.wait(0.01):
                for boot_id in ("one", "two"):
                    hardware.publisher(CLOCK).publish(tick.model_copy(update={"boot_id": boot_id}))

        other = threading.Thread(target=tick_twice)
        other.start()
        monkeypatch.setattr(network, "HEAR_S", 10.0)  # it returns as soon as it has heard both
        try:
            doubled = verdicts(network.service_rows(bus, set(needed), needed))
        finally:
            quiet.set()
            other.join()
        assert doubled == {"services": "ok", "one cell on its keys": "wrong"}


# --------------------------------------------------------------------------------------------------------------- clocks


@pytest.mark.parametrize(("late_s", "verdict"), [(1e-4, "ok"), (0.02, "warning"), (0.3, "wrong")])
def test_a_late_timer_is_judged_by_what_the_arm_bears(late_s: float, verdict: str) -> None:
    row = clocks.timer_row("timer", [late_s] * 300, clocks.LATE_S, 0.1, 1.0, 2)
    assert row.verdict.value == verdict and f"{late_s * 1e3:.2f} ms (p99)" in row.found


def test_clocks_that_do_not_go_together_are_told() -> None:
    apart = [{"began_ns": 5, "ended_ns": 6}, {"began_ns": 105, "ended_ns": 106}]
    assert clocks.one_time_row(0, apart, 200).verdict is Verdict.OK
    assert clocks.one_time_row(0, apart, 50).verdict is Verdict.WRONG
    assert clocks.wall_row(1e-5).verdict is Verdict.OK and clocks.wall_row(0.5).verdict is Verdict.WARNING
    assert clocks.urgency_row("real time").verdict is Verdict.OK
    assert clocks.urgency_row("").verdict is clocks.urgency_row("nice -10").verdict is Verdict.WARNING


# -------------------------------------------------------------------------------------------------------------- machine


def test_the_folder_of_recordings_can_be_written_and_has_room(tmp_path: Path) -> None:
    assert verdicts(machine.disk_rows(tmp_path / "new" / "recordings", 1, 1)) == {"disk": "ok"}
    (tmp_path / "file").write_text("")
    assert verdicts(machine.disk_rows(tmp_path / "file" / "recordings")) == {"disk": "wrong"}
    assert list(machine.state_rows(tmp_path / "run")) == []
    if Path("/proc/self").exists():  # nobody may write there, whatever its bits say to root
        told = [*machine.disk_rows(Path("/proc/self/recordings")), *machine.state_rows(Path("/proc/self"))]
        assert verdicts(told) == {"disk": "wrong", "state of stacks": "wrong"} and every_bad_row_has_a_mend(told)
        assert "CROSSPIH_RUN_DIR" in told[1].mend
    assert verdicts(machine.disk_rows(tmp_path, 1 << 62, 1 << 62)) == {"disk": "wrong"}
    assert verdicts(machine.disk_rows(tmp_path, 1, 1 << 62)) == {"disk": "warning"}


def test_device_files_are_there_and_may_be_used(tmp_path: Path) -> None:
    (tmp_path / "ttyUSB0").write_text("")
    files = [("hardware.robotiq.serial", name) for name in ("/dev/null", "/dev/no-such", str(tmp_path / "ttyUSB0"))]
    rows = list(machine.device_file_rows(files))
    assert [row.verdict.value for row in rows] == ["ok", "wrong", "wrong"]
    assert "plug it in" in rows[1].mend and "is no device" in rows[2].found


def test_receive_buffers_are_large_enough_where_a_driver_needs_them(tmp_path: Path) -> None:
    said = tmp_path / "rmem_max"
    assert list(machine.buffer_rows({"simulated"}, said)) == []
    assert verdicts(machine.buffer_rows({"genicam"}, said)) == {"receive buffer": "warning"}
    said.write_text("212992\n")
    assert verdicts(machine.buffer_rows({"ati"}, said)) == {"receive buffer": "ok"}
    assert verdicts(machine.buffer_rows({"genicam", "ati"}, said)) == {"receive buffer": "warning"}


# -------------------------------------------------------------------------------------------------------------- devices


def test_addresses_are_found_in_the_file_and_knocked_at(listener: int, monkeypatch: pytest.MonkeyPatch) -> None:
    hosts, files = addresses.addresses(
        {
            "driver": "ur",
            "ur": {"host": "127.0.0.1", "gain": 300},
            "robotiq": {"serial": "/dev/ttyUSB0"},
            "options": {"robot": "localhost", "port": listener, "note": "hello", "at": f"127.0.0.1:{listener}"},
            "limits": {"force_cap_n": 60},
        }
    )
    assert [(one.setting, one.host, one.port) for one in hosts] == [
        ("hardware.ur.host", "127.0.0.1", None),
        ("hardware.options.robot", "localhost", listener),
        ("hardware.options.at", "127.0.0.1", listener),
    ]
    assert files == [("hardware.robotiq.serial", "/dev/ttyUSB0")]
    assert {row.verdict for row in addresses.address_rows(hosts)} == {Verdict.OK}
    refused = addresses.address_row(addresses.Address("hardware.x.host", "127.0.0.1", free_port()))
    assert refused.verdict is Verdict.WARNING and "UDP" in refused.mend
    nobody = addresses.address_row(addresses.Address("hardware.x.host", "no-such-host.invalid", 502))
    assert nobody.verdict is Verdict.WRONG and "no such name" in nobody.found
    # no network of tests holds a host that is silent for sure
    monkeypatch.setattr(addresses, "_knock", lambda host, port: "silent")
    monkeypatch.setattr(addresses, "_echoes", lambda host: False)
    silent = addresses.address_row(addresses.Address("hardware.x.host", "127.0.0.1", 502))
    assert silent.verdict is Verdict.WRONG and "switched on" in silent.mend


def test_devices_are_opened_by_their_driver_or_what_keeps_them_is_named(tmp_path: Path) -> None:
    wall = list(devices.opened_rows(ROOT / "docs" / "examples" / "spring-wall.yaml"))
    assert len(wall) == 1 and "opens no camera; name another driver for it" in wall[0].found
    broken = tmp_path / "cell.yaml"
    broken.write_text("hardware: {dirver: simulated}")
    rows = list(devices.opened_rows(broken))
    assert verdicts(rows) == {"section hardware": "wrong"} and "hardware.dirver: no such setting" in rows[0].found


def test_a_running_hardware_service_is_asked_on_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "HEAR_S", 0.05)
    hub = MemoryHub()
    camera = CameraModel(width_px=64, height_px=48, fx_px=40.0, fy_px=40.0, cx_px=32.0, cy_px=24.0)
    pose = PoseData(position_m=(0.0, 0.0, 0.0), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    with Bus(hub.transport(), "c", "hardware") as hardware, Bus(hub.transport(), "c", "operator") as bus:
        silent = list(devices.running_rows(bus, devices.DEVICES))
        assert set(verdicts(silent).values()) == {"wrong"} and every_bad_row_has_a_mend(silent)
        tick = CellClock(stamp_ns=1, boot_id="b", realtime=False, simulated=True)
        hardware.publisher(CLOCK).publish(tick)
        hardware.publisher(CAMERA_CALIBRATION).publish(
            CameraCalibration(left=camera, right=camera, pose_left_right=pose, pose_base_camera=pose)
        )
        assert set(verdicts(devices.running_rows(bus, devices.DEVICES)).values()) == {"ok"}
        assert "time stands" in next(devices.running_rows(bus, devices.DEVICES)).found
        still = tick.model_copy(update={"realtime": True})
        hardware.publisher(CLOCK).publish(still)
        assert verdicts(devices.running_rows(bus, ("arm",))) == {"device arm": "wrong"}


def test_a_look_that_fails_itself_is_a_row() -> None:
    def broken() -> list[Row]:
        raise ZeroDivisionError("1 / 0")

    assert looked("timer", broken)[0].found == "could not be looked at: ZeroDivisionError: 1 / 0"


def test_devices_are_left_alone_where_a_hardware_service_may_hold_them() -> None:
    row = devices.not_opened_row({"planning", "vision"})
    assert row.verdict is Verdict.WARNING and "planning, vision live" in row.found and "logs hardware" in row.mend


# ------------------------------------------------------------------------------------------------------------- sections


BROKEN = """
hardware: {limits: {force_cap_n: -1}}
vision: {looks: 99}
force_torque: {filter_hz: fast}
inference: {samples: 3}
planning: {max_attempts: none}
recorder: {direktory: here}
ros2: {distro: noetic}
operator: {board: {pattern: a board}}
router: {port: 7447}
"""


def test_each_service_reads_its_own_section_and_names_what_is_wrong_in_it(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(BROKEN)
    read = sections.read_sections(file, load_cell(file))
    found = {row.name: row for row in read.rows}
    named = {
        "section hardware": "hardware.limits.force_cap_n", "section vision": "vision.looks",
        "section force_torque": "force_torque.filter_hz", "section inference": "inference.samples",
        "section planning": "planning.max_attempts", "section recorder": "recorder.direktory: no such setting",
        "section ros2": "ros2.distro", "section operator": "operator.board.pattern", "section router": "router: port",
    }  # fmt: skip
    assert found.keys() == named.keys() and read.settings == {}
    assert not [name for name, words in named.items() if words not in found[name].found]
    no_assembly = {name for name, row in found.items() if row.verdict is Verdict.WRONG}
    assert no_assembly == {f"section {name}" for name in sections.NEEDED} and every_bad_row_has_a_mend(list(read.rows))


def test_a_service_that_cannot_be_loaded_is_named_with_what_it_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sections, "NEEDED", ("recorder", "no_such_service"))
    file = tmp_path / "cell.yaml"
    file.write_text("recorder: {directory: elsewhere}")
    read = sections.read_sections(file, load_cell(file))
    assert verdicts(list(read.rows)) == {"sections": "ok", "section no_such_service": "wrong"}
    assert "does not start" in read.rows[1].found and "crosspih[no_such_service]" in read.rows[1].mend
    assert read.filled(load_cell(file)).sections["recorder"] == read.settings["recorder"]
    assert read.settings["recorder"]["directory"] == "elsewhere" and read.settings["recorder"]["flush_s"] > 0.0


# -------------------------------------------------------------------------------------------------------------- command


def test_the_exit_status_says_whether_an_assembly_could_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CROSSPIH_ENDPOINT", f"tcp/127.0.0.1:{free_port()}")
    monkeypatch.chdir(tmp_path)
    cell = tmp_path / "cell.yaml"
    cell.write_text("cell: {name: doctored, hole: {clearance_m: 0.00002}}\nplanning: {no_such: 1}")
    result = CliRunner().invoke(app, ["doctor", "--cell", str(cell), "--no-devices", "--json"])
    said = json.loads(result.stdout)
    named = {row["name"]: row for row in said["rows"]}
    assert result.exit_code == 1 and not said["ok"]
    assert named["peg in hole"]["verdict"] == "wrong" and named["cell file"]["verdict"] == "ok"
    # what rests on a section that cannot be read is left out
    assert named["section planning"]["verdict"] == "wrong" and "reach" not in named
    sound = ("python", "wheels", "sections", "router", "insertion depth", "clock of all processes")
    assert {name: row["verdict"] for name, row in named.items() if name in sound} == dict.fromkeys(sound, "ok")
    assert {"timer", "timer of beats", "wall clock", "real-time priority", "disk"} <= named.keys()
    assert all(row["mend"] for row in named.values() if row["verdict"] != "ok")
    # what is no row of the file's was looked at above
    monkeypatch.setattr(clocks, "clock_rows", lambda timeout_s: iter(()))
    monkeypatch.setattr(software, "wheel_rows", lambda: iter(()))
    cell.write_text("cell: {nmae: doctored}")
    result = CliRunner().invoke(app, ["doctor", "--cell", str(cell), "--no-devices", "--json"])
    named = {row["name"]: row for row in json.loads(result.stdout)["rows"]}
    assert result.exit_code == 1 and "cell.nmae: no such setting" in named["cell file"]["found"]
