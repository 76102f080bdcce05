"""The cell's clock, which every stamp uses."""

from __future__ import annotations

from crosspih_common.messages.base import Message


class CellClock(Message):
    """`stamp_ns` is the time. A new `boot_id` means that the cell was started again and its clock with it.

    `simulated`: the cell serves `simulation/reset` and tells its truth. A real one leaves it out.
    """

    boot_id: str
    realtime: bool
    simulated: bool = False
