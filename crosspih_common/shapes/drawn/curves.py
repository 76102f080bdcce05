"""The output of a drawing reader: the curves of a file, and the names of entities that it leaves out."""

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
    """A drawing that cannot be used: the text names the entity and how to correct it."""


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
        """Whether it is a closed curve with a length above zero."""
        return self.gap_m <= JOINED_M and len(self.points_m) > 3


@dataclass(slots=True)
class Sheet:
    """The curves of a file. `y_down`: the file's y axis points down; texts give places in the file's sense, in mm."""

    y_down: bool
    curves: list[Curve] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    parts: int = 0
    points: int = 0

    def draw(self, entity: str, points_m: Array) -> None:
        """Add a curve; one without length is ignored."""
        if len(points_m) < 2 or float(np.max(np.ptp(points_m, axis=0))) <= FINE_M:
            return
        if not np.all(np.isfinite(points_m)) or float(np.max(np.abs(points_m))) > 1e3:
            raise DrawingRefused(f"{entity} lies farther than a kilometre off; see its coordinates and the unit")
        self.points += len(points_m)
        if self.points > MAX_POINTS:
            raise DrawingRefused(f"more than {MAX_POINTS} points are drawn; simplify the drawing")
        self.curves.append(Curve(entity, points_m))

    def count(self, entity: str) -> None:
        """Count an entity; raises DrawingRefused if there are too many."""
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
