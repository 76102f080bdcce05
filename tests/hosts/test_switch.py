"""The network between the bench's hosts: what is late, lost and cut."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from services.operator.bench.reliability.hosts.switch import DESTINATION, Switch, packed

A, B = packed("10.77.0.1"), packed("10.77.0.2")


def packet(destination: bytes, text: bytes = b"") -> bytes:
    header = bytearray(20)
    header[0] = 0x45
    header[DESTINATION] = destination
    return bytes(header) + text


@pytest.fixture
def ends() -> Iterator[tuple[int, int]]:
    """B's device, as the switch writes it and as the host reads it."""
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    yield reading, writing
    os.close(reading)
    os.close(writing)


def test_a_packet_arrives_when_its_delay_is_over_and_not_before(ends: tuple[int, int]) -> None:
    reading, writing = ends
    switch = Switch({A: -1, B: writing}, delay_s=0.05)
    switch.take(A, packet(B, b"one"), 10.0)
    switch.take(A, packet(B, b"two"), 10.01)
    assert switch.hand_on(10.04) == pytest.approx(0.01)
    with pytest.raises(BlockingIOError):
        os.read(reading, 100)
    assert switch.hand_on(10.051) == pytest.approx(0.009)
    assert os.read(reading, 100) == packet(B, b"one")
    assert switch.hand_on(10.06) is None
    assert os.read(reading, 100) == packet(B, b"two")


def test_packets_are_lost_at_the_rate_asked_for_and_counted(ends: tuple[int, int]) -> None:
    switch = Switch({A: -1, B: ends[1]}, delay_s=1e9)
    switch.told({"loss": 0.01})
    for _ in range(10_000):
        switch.take(A, packet(B), 0.0)
    counts = switch.told({})
    assert counts["passed"] + counts["lost"] == 10_000
    assert 60 <= counts["lost"] <= 140  # four standard deviations of 100


def test_a_host_without_its_cable_gets_and_sends_nothing(ends: tuple[int, int]) -> None:
    switch = Switch({A: -1, B: ends[1]})
    switch.told({"out": ["10.77.0.2"]})
    switch.take(A, packet(B), 0.0)
    switch.take(B, packet(A), 0.0)
    assert switch.hand_on(1.0) is None and switch.told({"out": []})["cut"] == 2
    switch.take(A, packet(B), 1.0)
    switch.hand_on(1.0)
    assert os.read(ends[0], 100) == packet(B)


def test_what_is_no_ipv4_or_for_nobody_goes_nowhere() -> None:
    switch = Switch({A: -1})
    switch.take(A, b"\x60" + packet(A)[1:], 0.0)
    switch.take(A, packet(packed("10.77.0.9")), 0.0)
    assert switch.hand_on(1.0) is None and switch.passed == 0
