"""The cell's clock, which every stamp uses, and the wall clock of its machine, which none does."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import MAX_STAMP_NS, Message


class CellClock(Message):
    """`stamp_ns` is the time. A new `boot_id` means that the cell was started again and its clock with it.

    `simulated`: the cell serves `simulation/reset` and tells its truth. A real one leaves it out.
    """

    boot_id: str
    realtime: bool
    simulated: bool = False


class AskWallClock(Message):
    """Which wall time is it at the cell? Asked to tell how far another machine's clock is from it."""


class WallClock(Message):
    """The wall clock of the cell's machine, when it was asked."""

    host: str = Field(max_length=255, description="the machine's name")
    wall_ns: int = Field(ge=0, le=MAX_STAMP_NS, description="since 1970, UTC")
