"""What a reader gives: the curves that a file draws, and what it leaves out by name."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from crosspih_common.geometry.pose import Array

FINE_M = 1e-6
"""How far the points of a curve, joined by chords, may be from the curve as it is read."""
JOINED_M = 1e-5
MAX_PARTS = 20_000
MAX_BYTES = 40_000_000
MAX_POINTS = 500_000


class DrawingRefused(ValueError):
    """A drawing that is not read: the text names what in it, and the mend."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One curve of a file: what it is called there, and its points (n, 2), m, y up, no more than `FINE_M` off."""

    entity: str
    points_m: Array

    @property
    def gap_m(self) -> float:
        """From its end to its start."""
        return float(np.hypot(*(self.points_m[-1] - self.points_m[0])))

    @property
    def closed(self) -> bool:
        """Whether it ends where it began, and goes somewhere between."""
        return self.gap_m <= JOINED_M and len(self.points_m) > 3


@dataclass(slots=True)
class Sheet:
    """What a file draws. `y_down`: its own y runs down the page; places are told in its own sense, in mm."""

    y_down: bool
    curves: list[Curve] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    parts: int = 0
    points: int = 0

    def draw(self, entity: str, points_m: Array) -> None:
        """One curve more; what has no length is none."""
        if len(points_m) < 2 or float(np.max(np.ptp(points_m, axis=0))) <= FINE_M:
            return
        if not np.all(np.isfinite(points_m)) or float(np.max(np.abs(points_m))) > 1e3:
            raise DrawingRefused(f"{entity} lies farther than a kilometre off; see its coordinates and the unit")
        self.points += len(points_m)
        if self.points > MAX_POINTS:
            raise DrawingRefused(f"more than {MAX_POINTS} points are drawn; simplify the drawing")
        self.curves.append(Curve(entity, points_m))

    def count(self, entity: str) -> None:
        """One part more is looked at; raises DrawingRefused where they become too many."""
        self.parts += 1
        if self.parts > MAX_PARTS:
            raise DrawingRefused(
                f"more than {MAX_PARTS} parts are drawn, {entity} among them, with what stands for others (use, "
                f"symbol, INSERT) followed; draw the outline itself, once"
            )

    def place(self, point_m: Array) -> str:
        """A place in the file's own sense: "(10.000, 12.000) mm"."""
        x, y = float(point_m[0]) * 1e3 + 0.0, float(point_m[1]) * (-1e3 if self.y_down else 1e3) + 0.0
        return f"({x:.3f}, {y:.3f})"
