from __future__ import annotations

from crosspih_common.bus.clock import AHEAD_NS, BusClock

S = 1_000_000_000


def test_any_stamp_moves_it_forward_and_none_back() -> None:
    clock = BusClock()
    clock.observe(1, "first")
    for stamp_ns in (3, 9, 5):
        clock.observe(stamp_ns)
    assert clock.now_ns() == 9


def test_a_cell_that_was_started_again_starts_it_anew() -> None:
    clock = BusClock()
    clock.observe(60 * S, "first")
    clock.observe(2 * S, "second")
    assert clock.now_ns() == 2 * S
    clock.observe(S, "second")
    assert clock.now_ns() == 2 * S


def test_a_stamp_from_before_the_cells_restart_does_not_move_it() -> None:
    clock = BusClock()
    clock.observe(59 * S, "first")
    clock.observe(60 * S)
    clock.observe(2 * S, "second")
    clock.observe(60 * S)
    assert clock.now_ns() == 2 * S
    clock.observe(2 * S + AHEAD_NS)
    assert clock.now_ns() == 2 * S + AHEAD_NS


def test_a_stamp_of_another_clock_before_the_first_tick_does_not_move_it() -> None:
    clock = BusClock()
    clock.observe(1_750_000_000 * S)  # somebody's UNIX time
    assert clock.now_ns() == 0
    clock.observe(2 * S, "first")
    assert clock.now_ns() == 2 * S
