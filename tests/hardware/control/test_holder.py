"""How the arm's loop tells a holder that is gone from a machine that is held up: known times, no waiting."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from services.hardware.control.holder import CUT_OFF_S, WINDOW_S, Holder

TIMEOUT_S = 0.1


class Loop:
    """An arm's loop on a wall clock of its own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.wall_s, self.cell_s = 100.0, 0.0
        clock = SimpleNamespace(monotonic=lambda: self.wall_s)
        monkeypatch.setattr("services.hardware.control.holder.time", clock)
        self.holder = Holder(TIMEOUT_S, realtime=True)
        self.lease = self.holder.take("planning", "a test", 0)
        self.holder.begin(0)

    def cycle(self, wall_s: float, cell_s: float = 1e-3) -> bool:
        self.wall_s += wall_s
        self.cell_s += cell_s
        return self.holder.lost(round(self.cell_s * 1e9))

    def until_lost_s(self, walls_s: tuple[float, ...]) -> float:
        """Cycles of 1 ms that take so long, again and again; the cell's time when the holder is lost."""
        start_s = self.cell_s
        for number in range(5000):
            if self.cycle(walls_s[number % len(walls_s)]):
                return self.cell_s - start_s
        raise AssertionError("never lost")


@pytest.mark.parametrize("walls_s", [(1e-3,), (2e-4, 2e-4, 2.6e-3), (1e-5,) * 19 + (2e-2 - 19e-5,)])
def test_cut_off_as_soon_however_the_loop_spreads_its_cycles(
    monkeypatch: pytest.MonkeyPatch, walls_s: tuple[float, ...]
) -> None:
    lost_s = Loop(monkeypatch).until_lost_s(walls_s)
    assert CUT_OFF_S <= lost_s <= CUT_OFF_S + WINDOW_S


def test_a_loop_that_was_held_up_has_not_lost_its_holder(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Loop(monkeypatch)
    for _ in range(20):
        assert not loop.cycle(2.0)  # the whole machine stood
        assert not any(loop.cycle(1e-5) for _ in range(2000))  # and the loop catches up
        loop.holder.beat(loop.lease)


def test_beats_of_the_arm_alone_mean_that_the_holder_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, period_s = Loop(monkeypatch), Holder(TIMEOUT_S, realtime=True).beat_s
    for number in range(1, 1000):
        if number % round(period_s / 1e-3) == 0:
            loop.holder.own_beat()
        if loop.cycle(1e-3):
            break
    assert TIMEOUT_S <= loop.cell_s <= 2 * TIMEOUT_S
