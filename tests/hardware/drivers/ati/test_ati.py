"""The driver of ATI's Net F/T against a peer that speaks its protocol, a process of its own; and the peer against two
clients that others wrote."""

from __future__ import annotations

import dataclasses
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import Dwell, MotionOutcome, StopReason
from services.hardware.config import HardwareConfig
from services.hardware.drivers.ati import opening
from services.hardware.drivers.ati.device import AtiWrench
from services.hardware.drivers.ati.page import fetch_page
from services.hardware.drivers.registry import OpenRequest
from services.hardware.hosting import open_cell
from tests.conftest import ROOT
from tests.hardware.drivers.peers import Peer, Told, serving, wait_until

WRENCH = (1.5, -2.25, 30.0, 0.125, -0.5, 0.75)
SENSOR = frozenset({"force_torque"})
ARM = frozenset({"arm", "force_torque"})


def request_of(peer: Peer, told: Told, realtime: bool = True, cell: Workcell | None = None, **more: Any) -> OpenRequest:
    hardware, ati = {key: more.pop(key) for key in ("limits",) if key in more}, more
    ports = {"rdt_port": peer.ports["rdt"], "http_port": peer.ports["http"]}
    config = HardwareConfig.model_validate({"ati": {"host": "127.0.0.1", **ports, **ati}, **hardware})
    return OpenRequest(cell or Workcell(), config, SENSOR, realtime, told)


def opened(peer: Peer, told: Told, **ati: Any) -> AtiWrench:
    wrench = opening.open_devices(request_of(peer, told, **ati)).wrench
    assert isinstance(wrench, AtiWrench)
    return wrench


@pytest.fixture
def peer() -> Iterator[Peer]:
    ports = ("--rdt-port", "0", "--http-port", "0")
    with serving("ati", *ports, "--wrench", *map(str, WRENCH), "--drift-ppm", "80") as one:
        yield one


def newest(wrench: AtiWrench) -> np.ndarray[Any, np.dtype[np.float64]]:
    rows: list[Any] = []

    def come() -> bool:
        rows.extend(wrench.read().wrenches)
        return bool(rows)

    wait_until(come, "a record")
    return np.asarray(rows[-1])


def test_wrenches_come_in_newtons_with_stamps_of_this_machine(peer: Peer) -> None:
    told = Told()
    wrench = opened(peer, told)
    try:
        assert wrench.period_s == pytest.approx(0.001) and wrench.clock.settled
        stamps: list[int] = []
        rows: list[Any] = []

        def come() -> bool:
            got = wrench.read()
            stamps.extend(got.stamps_ns.tolist())
            rows.extend(got.wrenches)
            return len(rows) >= 500

        wait_until(come, "500 records")
        assert np.array(rows) == pytest.approx(np.tile(WRENCH, (len(rows), 1)), abs=1e-6)
        # one a millisecond of its own clock, by a few ppm, whenever it was that they were read
        counted = wrench.counts.received + wrench.counts.missed
        assert (stamps[-1] - stamps[0]) * 1e-9 == pytest.approx(0.001 * (counted - 1), rel=2e-3)
        assert 0.0 <= time.monotonic() - stamps[-1] * 1e-9 < 1.0
        peer.feed(10.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        wait_until(lambda: newest(wrench)[0] == pytest.approx(10.0), "what was fed")
    finally:
        wrench.close()


def test_stamps_are_when_each_sample_was_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """The peer tells when, by the same machine's clock, through a clock of its own that is 150 ppm slow."""
    monkeypatch.setattr(opening, "LOOK_S", 2.3)
    ports = ("--rdt-port", "0", "--http-port", "0")
    with serving("ati", *ports, "--tell-time", "--drift-ppm", "-150", "--rate", "1400") as peer:
        wrench = opened(peer, Told())
        off_s: list[float] = []

        def look() -> bool:
            got = wrench.read()
            apart_s = (got.stamps_ns * 1e-9 - got.wrenches[:, 0] + 500.0) % 1000.0 - 500.0
            off_s.extend(np.abs(apart_s) - wrench.clock.uncertainty_s)
            return len(off_s) > 2000

        wait_until(look, "2000 samples")
        assert max(off_s) < 2e-5 and wrench.clock.uncertainty_s < 1e-3
        assert abs(wrench.clock.drift_ppm - 150.0) <= wrench.clock.drift_uncertainty_ppm
        wrench.close()


def test_other_units_are_the_same_wrench(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "LOOK_S", 0.3)
    units = ("--force-unit", "lbf", "--torque-unit", "kgf-cm", "--counts-per-torque", "2e5", "--rate", "3500")
    rated = ("--ratings", "75", "75", "220", "300", "300", "300")
    with serving("ati", "--rdt-port", "0", "--http-port", "0", "--wrench", *map(str, WRENCH), *units, *rated) as peer:
        wrench = opened(peer, Told())
        assert newest(wrench) == pytest.approx(WRENCH, abs=1e-5)
        assert wrench.period_s == pytest.approx(2 / 7000)
        wrench.close()


def test_what_goes_wrong_on_the_way_is_counted_and_told(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "LOOK_S", 0.3)
    told = Told()
    wrench = opened(peer, told)
    try:
        newest(wrench)
        before = dataclasses.replace(wrench.counts)
        peer.say("skip 25")
        wait_until(lambda: bool(wrench.read()) and wrench.counts.missed >= before.missed + 25, "a gap of 25")
        assert "missed so far" in told.text("samples_missed")
        peer.say("twice")
        wait_until(lambda: bool(wrench.read()) and wrench.counts.stale == before.stale + 1, "a double")
        peer.say("swap")
        wait_until(lambda: bool(wrench.read()) and wrench.counts.stale == before.stale + 2, "one overtaken")
        peer.say("status 0x82000000")
        wait_until(lambda: bool(wrench.read()) and "sensor_fault" in told.codes(), "the fault told")
        assert not len(wrench.read().wrenches)
        peer.say("status 0")
        wait_until(lambda: bool(wrench.read()) and "sensor_healthy" in told.codes(), "health told")
        newest(wrench)
    finally:
        wrench.close()


@pytest.mark.parametrize("away", ["off 1.5", "unplug 1.5"])
def test_a_box_that_was_away_is_back_within_five_seconds(
    peer: Peer, away: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "LOOK_S", 0.3)
    told = Told()
    wrench = opened(peer, told)
    try:
        newest(wrench)
        before = wrench.counts.missed
        peer.say(away)

        def been_away() -> bool:
            wrench.read()
            if away.startswith("off"):
                return wrench.clock.restarts >= 1 and wrench.counts.reconnections >= 1
            return wrench.counts.missed > before + 500 or wrench.counts.reconnections >= 1

        lost_s = wait_until(been_away, "the box away and back")
        lost_s += wait_until(
            lambda: bool(wrench.read()) and told.last("sensor_silent", "sensor_back"), "the sensor back"
        )
        assert lost_s < 1.5 + 5.0 and "sensor_silent" in told.codes()
        assert newest(wrench) == pytest.approx(WRENCH, abs=1e-6)
    finally:
        wrench.close()


def test_a_box_that_comes_back_with_another_calibration_is_not_believed(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "LOOK_S", 0.3)
    told = Told()
    wrench = opened(peer, told)
    try:
        peer.say("set cfgcalsn FT99999")
        peer.say("unplug 0.5")  # its stream goes on, in counts that mean something else
        wait_until(lambda: bool(wrench.read()) and "sensor_changed" in told.codes(), "the change told")
        assert "FT99999" in told.text("sensor_changed") and "calibrate" in told.text("sensor_changed")
        before = wrench.counts.disbelieved
        wait_until(
            lambda: not len(wrench.read().wrenches) and wrench.counts.disbelieved > before, "records, not believed"
        )
    finally:
        wrench.close()


def test_a_bias_is_set_when_asked_for_and_a_box_that_lost_it_is_not_believed(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "LOOK_S", 0.3)
    told = Told()
    wrench = opened(peer, told, bias=True)
    try:
        assert newest(wrench) == pytest.approx(np.zeros(6), abs=1e-6)
        peer.say("off 0.5")
        wait_until(lambda: bool(wrench.read()) and "sensor_changed" in told.codes(), "the change told")
        assert not len(wrench.read().wrenches)
    finally:
        wrench.close()


def test_what_would_make_the_numbers_wrong_is_refused_on_opening(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "LOOK_S", 0.2)

    def refused(words: str, **more: Any) -> None:
        with pytest.raises(ConfigError) as error:
            opening.open_devices(request_of(peer, Told(), **more))
        assert words in str(error.value), error.value

    refused("runs in real time", realtime=False)
    refused("FT7 must be in use, and the box uses FT00000", calibration="FT7")
    refused("force_cap_n: 400 N, and the sensor measures 330 N", limits={"force_cap_n": 400.0})
    lbf = Workcell.model_validate({"force_torque": {"force_unit": "lbf"}})
    refused("cell.force_torque.force_unit: lbf", cell=lbf)
    refused("hardware.ati.rate_hz: 500 is wanted, the box sends 1000", rate_hz=500)
    refused("7812 is said, but", internal_rate_hz=7812)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind(("127.0.0.1", 0))
        refused("0 records came; a firewall", rdt_port=deaf.getsockname()[1], timeout_s=0.2)
    refused("does not answer", http_port=1)
    peer.say("set comrdte Disabled")
    wait_until(lambda: "Disabled" in fetch_page("127.0.0.1", peer.ports["http"], 5.0), "the page")
    refused("RDT is switched off")
    peer.say("set comrdte Enabled")
    peer.say("status 0x80020000")
    wait_until(lambda: "0x8002" in fetch_page("127.0.0.1", peer.ports["http"], 5.0), "the page")
    refused("transducer saturated")


def test_an_arm_of_another_driver_stops_when_the_sensor_is_gone_and_goes_on_when_it_is_back(peer: Peer) -> None:
    told = Told()
    config = HardwareConfig.model_validate(
        {
            "driver": "docs.examples.spring_wall:open_devices",
            "drivers": {"force_torque": "ati"},
            "ati": {"host": "127.0.0.1", "rdt_port": peer.ports["rdt"], "http_port": peer.ports["http"]},
            "limits": {"missed_cycles": 10_000, "sensor_timeout_s": 0.5, "holder_timeout_s": 5.0},
        }
    )
    cell = open_cell(Workcell(), config, True, ARM, told)
    batches: list[Any] = []
    cell.arm.on_batch(batches.append)
    try:
        # longer than a busy machine keeps the peer from its core
        still = cell.arm.dwell(Dwell(duration_s=1.0))
        assert still.stop_reason is StopReason.COMPLETED and still.wrench_raw == pytest.approx(WRENCH, abs=1e-5)
        heard = [one for one in batches if still.start_stamp_ns < one.stamp_ns < still.stamp_ns]
        assert heard and all(one.period_ns == 1_000_000 for one in heard)
        outcomes: list[MotionOutcome] = []
        dwelling = threading.Thread(target=lambda: outcomes.append(cell.arm.dwell(Dwell(duration_s=10.0))))
        dwelling.start()
        peer.say("off 2.0")
        dwelling.join(30.0)
        assert outcomes[0].stop_reason is StopReason.SENSOR_LOST
        again: list[MotionOutcome] = []

        def goes_on() -> bool:
            again.append(cell.arm.dwell(Dwell(duration_s=0.3)))
            return again[-1].stop_reason is StopReason.COMPLETED

        assert wait_until(goes_on, "a motion after the sensor is back") < 2.0 + 5.0
        assert again[-1].wrench_raw == pytest.approx(WRENCH, abs=1e-5) and "sensor_back" in told.codes()
    finally:
        cell.close()


def test_two_clients_that_others_wrote_read_the_peer_alike() -> None:
    pynetft, netft = pytest.importorskip("pynetft"), pytest.importorskip("NetFT")
    with serving(
        "ati", "--host", "127.0.0.3", "--rdt-port", "49152", "--http-port", "0", "--wrench", *map(str, WRENCH),
        "--force-unit", "lbf", "--torque-unit", "lbf-in",
    ) as peer:  # fmt: skip
        config = pynetft.Config(sensor_host="127.0.0.3", http_port=peer.ports["http"], receive_timeout=5.0)
        with pynetft.Client(config) as client:
            sample = next(client.samples(timeout=10.0))
        lbf, lbf_in = 4.4482216152605, 4.4482216152605 * 0.0254
        assert [one * lbf for one in sample.force] == pytest.approx(WRENCH[:3], abs=1e-5)
        assert [one * lbf_in for one in sample.torque] == pytest.approx(WRENCH[3:], abs=1e-5)
        assert sample.status == 0 and (sample.force_unit.value, sample.torque_unit.value) == ("lbf", "lbf-in")
        sensor = netft.Sensor("127.0.0.3")
        sensor.sock.settimeout(10.0)
        with sensor.sock:
            assert sensor.getMeasurement() == list(sample.raw_wrench)


def test_the_simulated_cell_feels_the_same_behind_the_protocol() -> None:
    """docs/examples/sensor-behind-ati.yaml, on free ports, against the same cell without a protocol between."""
    file = load_cell(ROOT / "docs" / "examples" / "sensor-behind-ati.yaml")
    direct = open_cell(file.workcell, HardwareConfig(), realtime=False, wanted=ARM)
    try:
        expected = direct.arm.dwell(Dwell(duration_s=0.3)).wrench_raw
    finally:
        direct.close()
    with serving("ati", "--rdt-port", "0", "--http-port", "0") as peer:
        said = file.section("hardware", HardwareConfig).model_dump()
        said["ati"].update(rdt_port=peer.ports["rdt"], http_port=peer.ports["http"])
        said["options"]["feed"] = f"127.0.0.1:{peer.ports['feed']}"
        said["limits"].update(missed_cycles=10_000, sensor_timeout_s=1.0, holder_timeout_s=5.0)
        config = HardwareConfig.model_validate(said)
        cell = open_cell(file.workcell, config, realtime=True, wanted=ARM)
        try:
            found = cell.arm.dwell(Dwell(duration_s=0.3))
        finally:
            cell.close()
    assert found.stop_reason is StopReason.COMPLETED
    assert np.linalg.norm(expected[:3]) > 5.0 and found.wrench_raw == pytest.approx(expected, abs=0.1)


def test_a_sensor_is_looked_at_alone(peer: Peer, tmp_path: Path) -> None:
    cell = tmp_path / "cell.yaml"
    ports = {"rdt_port": peer.ports["rdt"], "http_port": peer.ports["http"]}
    hardware = {"drivers": {"force_torque": "ati"}, "ati": {"host": "127.0.0.1", **ports}}
    cell.write_text(yaml.safe_dump({"hardware": hardware}), encoding="utf-8")
    command = [sys.executable, "-m", "services.hardware.sensor", "--cell", str(cell), "--seconds", "1", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["mean"] == pytest.approx(WRENCH, abs=1e-4) and found["counts"]["received"] >= found["samples"] > 100
    assert found["samples_a_second"] == pytest.approx(1000.0, rel=0.05)
