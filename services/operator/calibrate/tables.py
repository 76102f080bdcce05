"""Tables that people read."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

UNITS = {"rx": (180.0 / np.pi, "°"), "ry": (180.0 / np.pi, "°"), "rz": (180.0 / np.pi, "°"), "x": (1e3, "mm"),
         "y": (1e3, "mm"), "z": (1e3, "mm"), "fx": (1.0, "px"), "fy": (1.0, "px"), "cx": (1.0, "px"),
         "cy": (1.0, "px")}  # fmt: skip


def values_table(title: str, values: list[dict[str, Any]], told: dict[str, float] | None = None) -> Table:
    """One row per value: the result, one sd, and half of the 95 % interval; with the value before, where given."""
    table = Table(title=title)
    for heading in ("", *(("before",) if told else ()), "found", "sd", "± 95 %", ""):
        table.add_column(heading, justify="left" if not heading else "right")
    for one in values:
        factor, unit = UNITS.get(one["name"].rsplit(" ", 1)[-1], (1.0, one.get("unit", "")))
        before = (f"{told[one['name']] * factor:.4f}" if one["name"] in told else "",) if told else ()
        numbers = (f"{one[name] * factor:.4f}" for name in ("value", "sd", "half_95"))
        table.add_row(one["name"], *before, *numbers, unit)
    return table


def say_missing(console: Console, found: dict[str, Any]) -> None:
    """Print advice and doubts, a line each."""
    for line in found.get("missing", ()):
        console.print(f"missing: {line}", style="yellow", highlight=False, markup=False, soft_wrap=True)
    for line in found.get("doubts", ()):
        console.print(f"doubtful: {line}", style="bold yellow", highlight=False, markup=False, soft_wrap=True)
