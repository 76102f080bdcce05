"""The driver of Robotiq's FT 300 against pymodbus' own server, by TCP and over a serial line, and against a data stream
on the latter; each a process of its own."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import Dwell, StopReason
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.robotiq import opening
from services.hardware.drivers.robotiq.config import RobotiqConfig
from services.hardware.drivers.robotiq.wire import PACKET, StreamReader, crc16, identity, wrench_of
from services.hardware.hosting import open_cell
from tests.conftest import ROOT
from tests.hardware.drivers.peers import Peer, Told, serving, wait_until

pytest.importorskip("pymodbus")
pytest.importorskip("serial")

WRENCH = (1.5, -2.25, 30.0, 0.125, -0.5, 0.75)
PER_COUNT = np.array([0.01, 0.01, 0.01, 0.001, 0.001, 0.001])
SENSOR = frozenset({"force_torque"})


def packet(*counts: int) -> bytes:
    body = b"\x20\x4e" + b"".join(count.to_bytes(2, "little", signed=True) for count in counts)
    return body + crc16(body).to_bytes(2, "little")


def test_the_crc_is_that_of_modbus() -> None:
    from pymodbus.framer.rtu import FramerRTU

    for data in (b"\x09\x03\x00\xb4\x00\x06", bytes(range(14)), b""):
        assert crc16(data) == int.from_bytes(FramerRTU.compute_CRC(data).to_bytes(2, "big"), "little")


def test_registers() -> None:
    assert wrench_of([150, 65311, 30000, 125, 65036, 0]) == pytest.approx([1.5, -2.25, 300.0, 0.125, -0.5, 0.0])
    assert identity([0x5331, 0x3201, 0x0105], [0x5359, 0x4E00, 0, 4711, 2026]) == "S12-1.1.5, serial SYN-4711 of 2026"


@settings(max_examples=60)
@given(
    st.lists(st.tuples(*[st.integers(-32768, 32767)] * 6), min_size=3, max_size=12),
    st.lists(st.integers(1, 40), min_size=1, max_size=30),
    st.binary(max_size=15),
    st.integers(0, 2),
)
def test_a_stream_in_pieces_is_read_whole(
    packets: list[tuple[int, ...]], pieces: list[int], begun: bytes, damaged: int
) -> None:
    """It begins in the middle of a packet; one of the next may be damaged."""
    hurt = 1 if damaged else None
    sent = bytearray(begun)
    for k, counts in enumerate(packets):
        one = bytearray(packet(*counts))
        if k == hurt:
            one[3 + damaged] ^= 0x11
        sent += one
    reader, found, at = StreamReader(), [], 0
    while at < len(sent):
        for size in pieces:
            found += reader.take(bytes(sent[at : at + size]))
            at += size
    whole = [counts for k, counts in enumerate(packets) if k != hurt]
    assert np.array([wrench for _, wrench in found]) == pytest.approx(np.array(whole) * PER_COUNT)
    assert reader.lost == round(len(begun) / PACKET) + (hurt is not None)


# --------------------------------------------------------------------------------------------------- with peers


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def sensor(kind: str, folder: Path, tcp_port: int = 0) -> Iterator[tuple[Peer, dict[str, Any]]]:
    """A peer, and what of it stands in the cell's file."""
    felt = ("--wrench", *map(str, WRENCH))
    if kind == "tcp":
        port = tcp_port or free_port()
        with serving("robotiq", "--tcp", str(port), *felt) as peer:
            yield peer, {"host": "127.0.0.1", "tcp_port": port}
    else:
        line = folder / "ttyFT300"
        with serving("robotiq", "--serial", str(line), *felt) as peer:
            yield peer, {"serial": str(line), "mode": kind}


def request_of(told: Told, robotiq: dict[str, Any], **more: Any) -> OpenRequest:
    cell = more.pop("cell", Workcell())
    realtime = more.pop("realtime", True)
    config = HardwareConfig.model_validate({"robotiq": {"timeout_s": 3.0, **robotiq}, **more})
    return OpenRequest(cell, config, SENSOR, realtime, told)


def opened(told: Told, robotiq: dict[str, Any]) -> Any:
    return opening.open_devices(request_of(told, robotiq)).wrench


def newest(wrench: Any) -> Any:
    rows: list[Any] = []

    def come() -> bool:
        rows.extend(wrench.read().wrenches)
        return bool(rows)

    wait_until(come, "a sample")
    return rows[-1]


@pytest.mark.parametrize("kind", ["tcp", "poll", "stream"])
def test_wrenches_come_and_a_sensor_that_was_away_is_back(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "SETTLE_S", 20.0)
    told, port = Told(), free_port()
    with sensor(kind, tmp_path, port) as (peer, where):
        wrench = opened(told, where)
        assert wrench.period_s == (0.01 if kind == "stream" else 0.02)
        assert newest(wrench) == pytest.approx(WRENCH, abs=1e-9)
        peer.feed(-12.34, 0.0, 0.0, 0.0, 0.0, 1.234)
        wait_until(lambda: newest(wrench) == pytest.approx([-12.34, 0, 0, 0, 0, 1.234]), "what was fed")
        if kind == "stream":
            before = wrench.counts.damaged
            peer.say("garble 3")
            wait_until(lambda: bool(wrench.read()) and wrench.counts.damaged >= before + 3, "damaged packets")
            assert "damaged" in told.text("samples_missed")
    # pulled: the process and its line are gone; and another one takes their place
    wait_until(lambda: bool(wrench.read()) and "sensor_silent" in told.codes(), "the silence told")
    with sensor(kind, tmp_path, port):
        back_s = wait_until(lambda: bool(wrench.read()) and "sensor_back" in told.codes(), "the sensor back")
        assert back_s < 5.0
        assert newest(wrench) == pytest.approx(WRENCH, abs=1e-9)
        assert wrench.counts.reconnections >= 1
        wrench.close()


def test_a_stream_that_another_program_left_running_is_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "SETTLE_S", 20.0)
    with sensor("stream", tmp_path) as (_, where):
        first = opened(Told(), where)
        newest(first)
        monkeypatch.setattr(first._link, "close", first._link._client.close)  # as a program that was killed
        first.close()
        second = opened(Told(), where)
        assert newest(second) == pytest.approx(WRENCH, abs=1e-9)
        second.close()


def test_what_cannot_be_is_refused_with_its_mend(tmp_path: Path) -> None:
    def refused(words: str, robotiq: dict[str, Any], **more: Any) -> None:
        with pytest.raises(ConfigError) as error:
            opening.open_devices(request_of(Told(), robotiq, **more))
        assert words in str(error.value), error.value

    refused("hardware.robotiq.serial", {"serial": str(tmp_path / "nothing")})
    refused("cannot be opened", {"host": "127.0.0.1", "tcp_port": free_port(), "timeout_s": 0.5})
    with sensor("tcp", tmp_path) as (peer, where):
        refused("4 its address", {**where, "device_id": 4, "timeout_s": 0.5})
        refused("runs in real time", where, realtime=False)
        refused("moment_cap_nm: 40 Nm", where, limits={"moment_cap_nm": 40.0})
        refused(
            "the driver robotiq tells N", where, cell=Workcell.model_validate({"force_torque": {"force_unit": "kgf"}})
        )
        peer.say("slow 0.03")
        peer.say("nonsense")
        assert peer.process.stdout is not None and "not understood" in peer.process.stdout.readline()
        refused("poll_hz: 100 is wanted", {**where, "poll_hz": 100.0})


@pytest.mark.parametrize("wrong", [{}, {"serial": "/dev/a", "host": "b"}, {"host": "b", "mode": "stream"}])
def test_where_it_is_must_be_said_once(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="serial"):
        RobotiqConfig.model_validate(wrong)


def test_the_simulated_cell_measures_the_same_behind_the_protocol(tmp_path: Path) -> None:
    """docs/examples/sensor-behind-ft300.yaml against the same cell without a protocol between."""
    file = load_cell(ROOT / "docs" / "examples" / "sensor-behind-ft300.yaml")
    arm = frozenset({"arm", "force_torque"})
    direct = open_cell(file.workcell, HardwareConfig(), realtime=False, wanted=arm)
    try:
        expected = direct.arm.dwell(Dwell(duration_s=0.3)).wrench_raw
    finally:
        direct.close()
    line = tmp_path / "ttyFT300"
    with serving("robotiq", "--serial", str(line), "--feed-port", "0") as peer:
        content = file.section("hardware", HardwareConfig).model_dump()
        content["robotiq"].update(serial=str(line))
        content["options"]["feed"] = f"127.0.0.1:{peer.ports['feed']}"
        content["limits"].update(missed_cycles=10_000, sensor_timeout_s=1.0, holder_timeout_s=5.0)
        cell = open_cell(file.workcell, HardwareConfig.model_validate(content), realtime=True, wanted=arm)
        try:
            found = cell.arm.dwell(Dwell(duration_s=0.3))
        finally:
            cell.close()
    assert found.stop_reason is StopReason.COMPLETED
    # the FT 300 tells hundredths of a newton and thousandths of a newton metre
    assert np.linalg.norm(expected[:3]) > 5.0 and found.wrench_raw == pytest.approx(expected, abs=0.1)
