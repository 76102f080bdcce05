"""`crosspih bench cell`: the cost of the simulated cell's own loop compared with the bare physics engine."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict
from rich.table import Table

PROGRAM = "services.hardware.rate"


class CellResult(BaseModel):
    """What `crosspih bench cell --json` prints: steps a second of CPU time, of the cell and its engine."""

    model_config = ConfigDict(frozen=True)

    steps_s: dict[str, dict[str, float]]


def table_of(result: CellResult) -> Table:
    """One row per engine: CPU time of a step, as a multiple of the engine's own."""
    table = Table(title="steps of 1 ms: CPU time, and against the engine alone")
    for column in ("engine", "alone µs", "at rest µs", "/ alone", "admittance move µs", "/ alone", "times real time"):
        table.add_column(column, justify="left" if column == "engine" else "right")
    for engine, rates in result.steps_s.items():
        alone, rest, move = (1e6 / rates[name] for name in ("engine", "cell", "move"))
        table.add_row(
            engine, f"{alone:.1f}", f"{rest:.1f}", f"{rest / alone:.2f}", f"{move:.1f}", f"{move / alone:.2f}",
            f"{1e3 / rest:.0f}, {1e3 / move:.0f}",
        )  # fmt: skip
    return table
