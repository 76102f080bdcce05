"""Every row of the doctor's table, sound and broken, by what is really so: ports, files, packages, cells."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import CellFile, Workcell, cell_of_text
from crosspih_common.keys import CAMERA_CALIBRATION, CLOCK
from crosspih_common.messages import (
    CameraCalibration,
    CameraModel,
    CellClock,
    PoseData,
    Strategy,
)
from services.force_torque.calibration_file import CalibrationFile, save_calibration
from services.force_torque.config import ForceTorqueConfig
from services.hardware.control.config import LimitsConfig
from services.operator.__main__ import app
from services.operator.doctor import (
    addresses,
    calibrations,
    clocks,
    devices,
    drawing,
    examination,
    machine,
    network,
    software,
)
from services.operator.doctor.row import Row, Verdict, looked
from services.operator.doctor.weights import weight_rows
from services.planning.config import PlanningConfig
from services.recorder.config import RecorderConfig

NOW = datetime(2026, 3, 1, tzinfo=timezone.utc)
ROOT = Path(__file__).resolve().parents[2]


def verdicts(rows: Iterator[Row] | list[Row]) -> dict[str, str]:
    return {row.name: row.verdict.value for row in rows}


def cell_of(text: str = "cell: {name: cell1}") -> CellFile:
    return cell_of_text(Path("cell.yaml"), text)


def every_bad_row_has_a_mend(rows: list[Row]) -> bool:
    return all(row.mend for row in rows if row.verdict is not Verdict.OK)


def test_what_the_doctor_knows_of_other_services_is_what_they_have() -> None:
    assert ForceTorqueConfig().calibration_file == calibrations.FT_FILE
    assert str(RecorderConfig().directory) == examination.RECORDINGS
    assert LimitsConfig().holder_timeout_s == examination.HOLDER_TIMEOUT_S
    assert PlanningConfig().approach_m == drawing.APPROACH_M


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
        assert "planning not" in silent[0].found and "does not tick" in silent[1].found
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
    assert verdicts(rows) == {"hardware section": "wrong"} and "hardware.dirver: no such setting" in rows[0].found


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


# -------------------------------------------------------------------------------------------------------------- command


def test_the_exit_status_says_whether_an_assembly_could_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CROSSPIH_ENDPOINT", f"tcp/127.0.0.1:{free_port()}")
    monkeypatch.chdir(tmp_path)
    cell = tmp_path / "cell.yaml"
    cell.write_text("cell: {name: doctored, hole: {clearance_m: 0.00002}}")
    result = CliRunner().invoke(app, ["doctor", "--cell", str(cell), "--no-devices", "--json"])
    said = json.loads(result.stdout)
    named = {row["name"]: row for row in said["rows"]}
    assert result.exit_code == 1 and not said["ok"]
    assert named["peg in hole"]["verdict"] == "wrong" and named["cell file"]["verdict"] == "ok"
    sound = ("python", "wheels", "router", "reach", "clock of all processes")
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
