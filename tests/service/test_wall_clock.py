"""How far two machines' wall clocks are apart: bounded, narrowed, told."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.keys import WALL_CLOCK
from crosspih_common.messages import AskWallClock, WallClock
from crosspih_common.service.wall_clock import APART_S, ClockOffset, ClockWatch, Exchange, measured, narrowed

CELL = "clocks"
DEADLINE_S = 10.0
WAYS_S = st.floats(0.0, 3.0)


def exchanged(ahead_s: float, there_s: float, back_s: float, at_s: float = 0.0) -> Exchange:
    """One of a machine that is so far ahead, whose question and answer took so long."""
    sent_s = 1000.0 + at_s + ahead_s
    there_ns = round((1000.0 + at_s + there_s) * 1e9)
    return Exchange(round(sent_s * 1e9), there_ns, round((sent_s + there_s + back_s) * 1e9), at_s)


@given(st.floats(-5.0, 5.0), st.lists(st.tuples(WAYS_S, WAYS_S), min_size=1, max_size=8))
def test_the_true_difference_lies_within_the_bound_whatever_the_ways_take(
    ahead_s: float, ways: list[tuple[float, float]]
) -> None:
    exchanges = [exchanged(ahead_s, there_s, back_s, 10.0 * index) for index, (there_s, back_s) in enumerate(ways)]
    found = narrowed(exchanges, "cell")
    assert found is not None
    assert abs(found.offset_s - ahead_s) <= found.bound_s + 1e-6
    assert found.bound_s <= exchanges[-1].bound_s + 1e-6
    assert found.least_s <= abs(ahead_s) + 1e-6


def test_two_ways_that_differ_bound_it_better_than_either() -> None:
    found = narrowed([exchanged(0.1, 0.2, 0.0), exchanged(0.1, 0.0, 0.2)], "cell")
    assert found is not None
    assert found.offset_s == pytest.approx(0.1, abs=1e-6) and found.bound_s == pytest.approx(0.0, abs=1e-6)


def test_what_was_known_before_a_clock_was_set_is_forgotten() -> None:
    found = narrowed([exchanged(0.0, 0.001, 0.001, 0.0), exchanged(0.5, 0.01, 0.01, 10.0)], "cell")
    assert found is not None
    assert found.offset_s == pytest.approx(0.5, abs=1e-6) and found.bound_s == pytest.approx(0.01, abs=1e-6)


class CellAt:
    """A cell in memory whose wall clock is so far behind this machine's."""

    def __init__(self, hub: MemoryHub) -> None:
        self.behind_s = 0.0
        self.bus = Bus(hub.transport(), CELL, "hardware")
        self.bus.serve(WALL_CLOCK, self._tell)

    def _tell(self, request: AskWallClock) -> WallClock:
        return WallClock(host="cell", wall_ns=time.time_ns() - round(self.behind_s * 1e9))


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def cell(hub: MemoryHub) -> Iterator[CellAt]:
    made = CellAt(hub)
    yield made
    made.bus.close()


@pytest.fixture
def bus(hub: MemoryHub, cell: CellAt) -> Iterator[Bus]:
    with Bus(hub.transport(), CELL, "recorder") as made:
        yield made


def test_clocks_that_are_apart_are_told_once_and_when_they_are_together_again(
    bus: Bus, cell: CellAt, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crosspih_common.service.wall_clock.FIRST_S", 0.01)
    monkeypatch.setattr("crosspih_common.service.wall_clock.PERIOD_S", 0.01)
    told: list[tuple[bool, ClockOffset]] = []
    cell.behind_s = 0.4
    watch = ClockWatch(bus, lambda apart, found: told.append((apart, found)))
    try:
        _until(lambda: len(told) == 1)
        apart, found = told[0]
        assert apart and found.least_s > APART_S
        assert abs(found.offset_s - 0.4) <= found.bound_s
        assert "ahead of that of the cell's machine, cell" in str(found)
        cell.behind_s = 0.0
        _until(lambda: len(told) == 2)
        assert not told[1][0]
    finally:
        watch.close()


def test_a_cell_that_tells_no_wall_clock_leaves_it_unknown(hub: MemoryHub) -> None:
    with Bus(hub.transport(), CELL, "operator") as alone:
        assert measured(alone, deadline_s=0.1) is None


def _until(holds: Callable[[], bool]) -> None:
    until = time.monotonic() + DEADLINE_S
    while not holds():
        assert time.monotonic() < until
        time.sleep(0.005)
