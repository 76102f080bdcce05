"""What an ATI box tells of itself, and what its records become: pure, and over a socket of its own."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.hardware.drivers.ati.config import AtiConfig
from services.hardware.drivers.ati.device import AtiWrench
from services.hardware.drivers.ati.page import PageUnreadable, read_page
from services.hardware.drivers.ati.rdt import RdtSocket
from services.hardware.drivers.ati.status import judge
from tests.hardware.drivers.peers import Told, wait_until

FIELDS = {
    "prodname": "Net F/T", "cfgcalsn": "FT12345", "scfgfu": "N", "scfgtu": "N-m", "cfgcpf": "1000000",
    "cfgcpt": "1000000", "cfgmr": "330;330;990;30;30;30", "cfgtfx": "0;0;0;0;0;0", "setbias": "0;0;0;0;0;0",
    "comrdte": "Enabled", "comrdtrate": "1000", "runrate": "7000", "runstat": "0x00000000",
}  # fmt: skip


def page(**changed: str | None) -> str:
    told = {name: value for name, value in {**FIELDS, **changed}.items() if value is not None}
    inner = "".join(f"<{name}>{value}</{name}>" for name, value in told.items())
    return f'<?xml version="1.0"?><netft>{inner}</netft>'


@pytest.mark.parametrize(
    ("force", "torque", "newtons", "newton_metres"),
    [
        ("N", "N-m", 1.0, 1.0),
        ("N", "Nm", 1.0, 1.0),
        ("lbf", "lbf-in", 4.4482216152605, 0.1129848290276),
        ("klbf", "lbf-ft", 4448.2216152605, 1.3558179483314),
        ("kN", "kN-m", 1e3, 1e3),
        ("kgf", "kgf-cm", 9.80665, 0.0980665),
        ("kgf", "N-mm", 9.80665, 1e-3),
    ],
)
def test_units_become_newtons_and_newton_metres(force: str, torque: str, newtons: float, newton_metres: float) -> None:
    told = read_page(page(scfgfu=force, scfgtu=torque, cfgcpf="800", cfgcpt="16000"))
    assert told.n_per_count == pytest.approx(newtons / 800.0, rel=1e-12)
    assert told.nm_per_count == pytest.approx(newton_metres / 16000.0, rel=1e-12)
    assert told.ratings == pytest.approx([330 * newtons] * 2 + [990 * newtons] + [30 * newton_metres] * 3)


def test_an_axia_spells_some_otherwise() -> None:
    told = read_page(page(prodname="Ethernet Axia", comrdtrate=None, commrdtrate="976", runrate=None, setrate="7812"))
    assert told.axia and told.rdt_rate_hz == 976.0 and told.internal_rate_hz == 7812.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (page(scfgfu="stone"), "scfgfu is 'stone'"),
        (page(scfgtu=None), "scfgtu is ''"),
        (page(cfgcpf="0"), "cfgcpf is '0'"),
        (page(cfgcpt="many"), "cfgcpt is 'many'"),
        ("<html>login", "is no XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><netft/>', "entities"),
    ],
)
def test_what_a_page_does_not_say_is_named(text: str, words: str) -> None:
    with pytest.raises(PageUnreadable, match="hardware") as refused:
        read_page(text)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("status", "table", "words", "overload", "believed"),
    [
        (0x00000000, "net_ft", "healthy", False, True),
        (0x80020000, "net_ft", "transducer saturated", True, True),
        (0x80010000, "net_ft", "monitor condition", False, True),
        (0x80800000, "net_ft", "calibration do not fit", False, False),
        (0x80820000, "net_ft", "transducer saturated", True, False),
        (0x80000000, "net_ft", "does not name", False, False),
        (0x80008000, "net_ft", "bit 15", False, False),
        (0xC0000000, "axia", "out of range", True, True),
        (0xC0000000, "net_ft", "CPU or RAM", False, False),
        (0xA0000000, "axia", "checksum", False, False),
        (0x00000008, "axia", "busy", False, True),
        (0x80000005, "axia", "gage is broken, internal temperature", False, False),
    ],
)
def test_status_words(status: int, table: str, words: str, overload: bool, believed: bool) -> None:
    verdict = judge(status, table)
    assert words in verdict.text and (verdict.overload, verdict.believed) == (overload, believed)


@contextmanager
def by_hand(told: Told) -> Iterator[tuple[socket.socket, AtiWrench]]:
    """A driver, and the other end of its socket: nothing is sent but what a test sends."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        box.bind(("127.0.0.1", 0))
        box.settimeout(10.0)
        config = AtiConfig(host="127.0.0.1", rdt_port=box.getsockname()[1], http_port=1)
        link = RdtSocket("127.0.0.1", config.rdt_port)
        wrench = AtiWrench(config, read_page(page()), link, 7000.0, 0.001, "net_ft", told)
        link.send(0x0002)
        assert box.recvfrom(64)[0] == bytes.fromhex("1234000200000000")
        try:
            yield box, wrench
        finally:
            wrench.close()


def send(box: socket.socket, wrench: AtiWrench, *records: tuple[int, int, int]) -> None:
    to = wrench._link._socket.getsockname()
    for rdt, ft, status in records:
        rdt, ft = rdt % 2**32, ft % 2**32
        box.sendto(struct.pack(">III6i", rdt, ft, status, *(rdt % 1000 * axis for axis in range(1, 7))), to)


def read_all(wrench: AtiWrench, count: int) -> tuple[list[int], list[list[float]]]:
    stamps: list[int] = []
    rows: list[list[float]] = []

    def come() -> bool:
        got = wrench.read()
        stamps.extend(got.stamps_ns.tolist())
        rows.extend(got.wrenches.tolist())
        return wrench.counts.received + wrench.counts.stale >= count

    wait_until(come, f"{count} records, {wrench.counts} came")
    return stamps, rows


@settings(max_examples=25)
@given(
    st.lists(st.sampled_from(["sent", "sent", "sent", "lost", "twice", "late"]), min_size=5, max_size=60),
    st.sampled_from([1, 2**32 - 20]),
    st.sampled_from([0, 7 * 5000, 2**32 - 150]),
)
def test_gaps_are_counted_and_what_comes_late_or_twice_is_dropped(fates: list[str], rdt0: int, ft0: int) -> None:
    fates = ["sent", *fates, "sent"]
    order: list[int] = []
    late: list[int] = []
    for k, fate in enumerate(fates):
        order += {"sent": [k], "lost": [], "twice": [k, k], "late": []}[fate]
        if fate == "sent":
            order += late
            late.clear()
        elif fate == "late":
            late.append(k)
    told = Told()
    with by_hand(told) as (box, wrench):
        send(box, wrench, *((rdt0 + k, ft0 + 7 * k, 0) for k in order))
        stamps, rows = read_all(wrench, len(order))
    accepted = [k for k, fate in enumerate(fates) if fate in ("sent", "twice")]
    # one that was overtaken counts as missed when the gap is seen, and as stale when it comes after all
    assert wrench.counts.stale == fates.count("twice") + fates.count("late")
    assert wrench.counts.missed == fates.count("lost") + fates.count("late")
    assert wrench.counts.received == len(accepted) == len(rows) == len(stamps)
    expected = np.array([[(rdt0 + k) % 2**32 % 1000 * axis for axis in range(1, 7)] for k in accepted]) * 1e-6
    assert np.array(rows) == pytest.approx(expected)
    assert np.all(np.diff(stamps) > 0)
    assert ("samples_missed" in told.codes()) == (wrench.counts.missed > 0)


def test_a_stream_that_begins_anew_is_no_gap() -> None:
    with by_hand(Told()) as (box, wrench):
        send(box, wrench, *((k, 70_000 + 7 * k, 0) for k in range(5, 9)))  # a stream that was on its way
        send(box, wrench, *((k, 70_500 + 7 * k, 0) for k in range(1, 4)))  # and the one that was asked for
        send(box, wrench, *((k, 7 * k, 0) for k in range(1, 4)))  # of a box that was restarted meanwhile
        _, rows = read_all(wrench, 10)
    assert len(rows) == 10 and wrench.counts.missed == wrench.counts.stale == 0


def test_what_is_not_believed_is_not_passed_on_and_an_overload_is() -> None:
    told = Told()
    with by_hand(told) as (box, wrench):
        statuses = [0, 0, 0x82000000, 0x82000000, 0, 0x80020000]
        send(box, wrench, *((k, 7 * k, status) for k, status in enumerate(statuses, 1)))
        _, rows = read_all(wrench, 6)
        assert [round(row[0] * 1e6) for row in rows] == [1, 2, 5, 6] and wrench.counts.disbelieved == 2
        assert told.codes() == ["sensor_overload"]  # of one read the newest status is told
        send(box, wrench, (7, 49, 0x82000000))
        read_all(wrench, 7)
        send(box, wrench, (8, 56, 0))
        read_all(wrench, 8)
    assert told.codes() == ["sensor_overload", "sensor_fault", "sensor_healthy"]
    assert "halted: its configuration is wrong" in told.text("sensor_fault")


def test_what_is_no_record_is_counted() -> None:
    with by_hand(Told()) as (box, wrench):
        box.sendto(b"what is this", wrench._link._socket.getsockname())
        send(box, wrench, (1, 7, 0))
        read_all(wrench, 1)
        assert wrench.counts.malformed == 1
