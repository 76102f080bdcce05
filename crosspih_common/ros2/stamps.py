"""Maps the cell's clock to the wall clock, because ROS uses wall time."""

from __future__ import annotations

NEAR_NS = 1_000_000_000  # a cell's clock within this of the wall clock is taken as wall time
JUMP_NS = 200_000_000


class WallOfCell:
    """Cell stamps as wall stamps, ns.

    A cell clock that already is wall time stays as it is. Any other is anchored at its first tick, and again at each
    new boot and whenever it is behind or ahead by more than `JUMP_NS`: a simulated cell stands still between commands,
    or runs faster.
    """

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._boot_id = ""

    def observe(self, stamp_ns: int, wall_ns: int, boot_id: str) -> None:
        """A tick of the cell's clock, ns, and the wall time of its arrival, ns."""
        offset_ns = wall_ns - stamp_ns
        if self._offset_ns is None or boot_id != self._boot_id or abs(offset_ns - self._offset_ns) > JUMP_NS:
            self._offset_ns = 0 if abs(offset_ns) < NEAR_NS else offset_ns
            self._boot_id = boot_id

    def wall_ns(self, stamp_ns: int) -> int | None:
        """The same instant by the wall's clock; None before the first tick."""
        return None if self._offset_ns is None else stamp_ns + self._offset_ns
