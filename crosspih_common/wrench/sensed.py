"""Refuses wrenches that no wrist sensor can measure, before anything is computed with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry.pose import Array

MAX_FORCE_N, MAX_MOMENT_NM = 1e5, 1e4  # several times the range of the largest wrist sensors


def refuse_implausible_wrench(wrench: Sequence[float] | Array, name: str) -> None:
    """Raises CommandRefused `implausible` for (6,) N and Nm that no wrist sensor can feel."""
    forces, moments = np.abs(np.asarray(wrench)).reshape(2, 3)
    if forces.max() > MAX_FORCE_N or moments.max() > MAX_MOMENT_NM:
        raise CommandRefused(
            "implausible",
            f"{name}: {forces.max():.3g} N and {moments.max():.3g} Nm; at most {MAX_FORCE_N:g} N and "
            f"{MAX_MOMENT_NM:g} Nm can be",
        )
