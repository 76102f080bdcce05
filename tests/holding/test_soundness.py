"""Whether one cell ticks or two."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as some

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.errors import CommandRefused
from crosspih_common.holding.soundness import require_not_doubled, require_one_clock
from crosspih_common.keys import CLOCK
from crosspih_common.messages import CellClock


def ticks(boot_ids: list[str]) -> list[CellClock]:
    return [CellClock(stamp_ns=index, boot_id=boot_id, realtime=True) for index, boot_id in enumerate(boot_ids)]


@given(some.lists(some.integers(1, 5), max_size=6))
def test_a_cell_that_was_started_again_and_again_is_one(lengths: list[int]) -> None:
    require_not_doubled("cell", ticks([f"boot{index}" for index, count in enumerate(lengths) for _ in range(count)]))


@given(some.lists(some.sampled_from("ab"), max_size=12))
def test_a_boot_id_that_comes_back_is_another_cells(boot_ids: list[str]) -> None:
    changes = [one for before, one in zip(["", *boot_ids], boot_ids, strict=False) if one != before]
    if len(changes) > 2:
        with pytest.raises(CommandRefused, match="two cells tick on the keys of cell"):
            require_not_doubled("cell", ticks(boot_ids))
    else:
        require_not_doubled("cell", ticks(boot_ids))


def test_a_clock_that_ticked_once_is_enough() -> None:
    hub = MemoryHub()
    with Bus(hub.transport(), "cell", "hardware") as hardware, Bus(hub.transport(), "cell", "operator") as operator:
        hardware.publisher(CLOCK).publish(CellClock(stamp_ns=7, boot_id="one", realtime=False))
        assert require_one_clock(operator).stamp_ns == 7


def test_no_clock_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crosspih_common.holding.soundness.CLOCK_DEADLINE_S", 0.01)
    with Bus(MemoryHub().transport(), "cell", "operator") as operator, pytest.raises(CommandRefused) as refused:
        require_one_clock(operator)
    assert refused.value.code == "cell_unfit" and "no clock" in refused.value.text
