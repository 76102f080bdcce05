"""`crosspih bench engines`: how many of the cell's steps of a millisecond each installed physics engine makes per
second.
"""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict
from rich.table import Table

# the operator imports no engine: a program of the hardware service measures
PROGRAM = "services.hardware.drivers.simulated.engines.rate"
BASELINE = "pybullet"


class EnginesResult(BaseModel):
    """What `crosspih bench engines --json` prints: steps a second by engine and scene."""

    model_config = ConfigDict(frozen=True)

    steps_s: dict[str, dict[str, float]]


def table_of(result: EnginesResult) -> Table:
    """The rates, and each relative to PyBullet's in the same run where that is installed."""
    table = Table(title="steps of 1 ms a second, one core")
    for column in ("engine", "scene", "steps/s", "times real time", f"against {BASELINE}"):
        table.add_column(column, justify="left" if column in ("engine", "scene") else "right")
    baseline = result.steps_s.get(BASELINE, {})
    for engine, scenes in result.steps_s.items():
        for scene, rate in scenes.items():
            ratio = f"{rate / baseline[scene]:.2f}" if scene in baseline else ""
            table.add_row(engine, scene, f"{rate:.0f}", f"{rate * 1e-3:.1f}", ratio)
    return table
