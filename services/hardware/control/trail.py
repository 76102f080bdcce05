"""The way that led here, so that the arm can go back along it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from operator import sub

import numpy as np

from crosspih_common.geometry.pose import Array

TRAIL_STEP_RAD = 4e-5  # some 20 micrometres at the peg
_LENGTH = 5000


class Trail:
    """Joint positions (n,) that were passed, oldest first, without the parts that were gone back over."""

    def __init__(self) -> None:
        self._points: deque[Array] = deque(maxlen=_LENGTH)

    def restart(self, joints_rad: Array) -> None:
        """A way that begins here."""
        self._points.clear()
        self._points.append(joints_rad)

    def follow(self, joints_rad: Array) -> None:
        """The arm goes here."""
        points, now = self._points, joints_rad.tolist()
        last: list[float] = points[-1].tolist()
        while len(points) > 1 and _turned(now, last, points[-2].tolist()):
            points.pop()
            last = points[-1].tolist()
        if max(map(abs, map(sub, now, last))) >= TRAIL_STEP_RAD:
            points.append(joints_rad)

    def __bool__(self) -> bool:
        return bool(self._points)

    def __iter__(self) -> Iterator[Array]:
        return iter(self._points)

    @property
    def newest(self) -> Array:
        """The last point (n,)."""
        return self._points[-1]

    def pop(self) -> None:
        """The last point was gone back over."""
        self._points.pop()

    def append(self, joints_rad: Array) -> None:
        """The way back ended here."""
        self._points.append(joints_rad)

    def back(self, joints_rad: Array, budget_rad: float) -> Array:
        """Where a step of the way back leads from joints (n,): along the trail, `budget_rad` of any joint at most.

        What it passes is popped.
        """
        while self._points:
            far = float(np.abs(self._points[-1] - joints_rad).max())
            if far > budget_rad:
                return np.asarray(joints_rad + (self._points[-1] - joints_rad) * (budget_rad / far))
            joints_rad = self._points.pop()
            budget_rad -= far
        return joints_rad


def _turned(joints_rad: list[float], last_rad: list[float], before_rad: list[float]) -> bool:
    """Whether these joints (n,) are back half the way from the last point to the one before it.

    In plain floats: of so few, several times sooner than by NumPy.
    """
    left: float = sum(map(abs, map(sub, joints_rad, before_rad)))
    step: float = sum(map(abs, map(sub, last_rad, before_rad)))
    return left <= 0.5 * step
