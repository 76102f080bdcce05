"""`crosspih bench caps`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import Annotated, Any

import typer
from pydantic import BaseModel
from rich.console import Console
from rich.table import Table

from crosspih_common.errors import ConfigError
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.local_executor import usable_cores
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.reliability.caps.presses import CapPressResult, press_all, presses

ENGINES = ("pybullet", "mujoco")
DELAYS_S = (0.001, 0.008)
DEFAULT_CAP_N = 60.0
ALLOWED = 1.1  # times the cap
PRESSES_A_TASK = 12


class Cap(BaseModel):
    """One row of the table: an engine, a delay, a press and its result."""

    engine: str
    delay_s: float
    pressed: CapPressResult

    def holds(self, cap_n: float) -> bool:
        """Whether the true peak stays under the cap and its tolerance."""
        return self.pressed.peak_contact_n <= ALLOWED * cap_n


def _tasks(engines: list[str], cap_n: float) -> Iterator[tuple[str, float, CellTask]]:
    for engine in engines:
        for delay_s in DELAYS_S:
            limits = {"sensor_delay_s": delay_s + 0.001, "force_cap_n": cap_n}
            overrides = {
                "hardware": {
                    "engine": engine, "limits": limits, "simulated": {"delay_s": delay_s, "watch_contact": True},
                }
            }  # fmt: skip
            content = cell_content(base_cell_text(), Condition(name=engine, overrides=overrides))
            rows = [one.model_dump(mode="json") for one in presses()]
            for first in range(0, len(rows), PRESSES_A_TASK):
                label = f"{engine} {delay_s * 1e3:g} ms {first}"
                part = rows[first : first + PRESSES_A_TASK]
                yield engine, delay_s, CellTask(label, content, press_all, part, ("hardware",), calibrate=False)


def table_of(rows: list[Cap], cap_n: float) -> Table:
    """True peaks by motion, speed and direction, one column per engine and delay."""
    columns = sorted({(row.engine, row.delay_s) for row in rows})
    table = Table(title=f"true peak of the contact force, N, against a rigid plate; the cap is {cap_n:g} N")
    for name in ("motion", "speed asked, m/s", "direction"):
        table.add_column(name)
    for engine, delay_s in columns:
        table.add_column(f"{engine}\n{delay_s * 1e3:g} ms", justify="right")
    found = {(row.pressed.press, row.engine, row.delay_s): row for row in rows}
    for press in dict.fromkeys(row.pressed.press for row in rows):
        where = f"{press.oblique_rad:g} rad oblique" if press.oblique_rad else "straight on"
        cells = []
        for column in columns:
            row = found[(press, *column)]
            text = f"{row.pressed.peak_contact_n:.1f}" + (" slowed" if row.pressed.notes else "")
            text = "refused" if row.pressed.refused else text
            cells.append(text if row.holds(cap_n) else f"[red]{text}[/red]")
        tilt = f", peg tilted {press.tilt_rad:g} rad" if press.tilt_rad else ""
        table.add_row(press.kind.value, f"{press.speed_m_s:g}", where + tilt, *cells)
    return table


def caps(
    engine: Annotated[list[str] | None, typer.Option(help="pybullet, mujoco; both when left out.")] = None,
    cap_n: Annotated[float | None, typer.Option(min=5.0, max=500.0, help="Another cap than the cell's.")] = None,
    cells: Annotated[int | None, typer.Option(min=1, help="Cells side by side; one a core without it.")] = None,
    as_json: AsJson = False,
) -> None:
    """Send each kind of motion at a rigid plate, up to the fastest that a message may ask for, and print how hard it
    truly pressed. Ends with status 0 only if none pressed more than 10 % beyond the cap.
    """
    console = Console(stderr=True)
    with errors_shown(console):
        chosen = list(engine or ENGINES)
        unknown = sorted(set(chosen) - set(ENGINES))
        if unknown:
            raise ConfigError(f"--engine {', '.join(unknown)}: want {' or '.join(ENGINES)}")
        cap = cap_n if cap_n is not None else _cap_of_cell()
        planned = list(_tasks(chosen, cap))
        rows: list[Cap] = []

        def on_result(index: int, result: Any) -> None:
            name, delay_s, _ = planned[index]
            rows.extend(Cap(engine=name, delay_s=delay_s, pressed=CapPressResult.model_validate(one)) for one in result)

        pool = open_executor(ExecutorName.LOCAL, cells or usable_cores(), len(planned))
        progress = CellsProgress(console, "presses")
        progress.taken_over(len(planned), 0)
        try:
            with progress:
                lost = run_in_cells([task for _, _, task in planned], pool, on_result, progress)
        finally:
            pool.close()
        if lost:
            raise ConfigError(f"{len(lost)} of {len(planned)} cells could not press: {next(iter(lost.values()))}")
        rows.sort(key=lambda row: (row.engine, row.delay_s))
        if as_json:
            json.dump([row.model_dump(mode="json") for row in rows], sys.stdout, indent=1)
            print()
        else:
            Console(width=160).print(table_of(rows, cap))
        beyond = [row for row in rows if not row.holds(cap)]
        console.print(
            f"{len(rows) - len(beyond)} of {len(rows)} presses stay below {ALLOWED * cap:g} N; the hardest: "
            f"{max(row.pressed.peak_contact_n for row in rows):.1f} N",
            highlight=False,
        )
        if beyond:
            raise typer.Exit(1)


def _cap_of_cell() -> float:
    content = cell_content(base_cell_text(), Condition())
    limits = (content.get("hardware") or {}).get("limits") or {}
    return float(limits.get("force_cap_n", DEFAULT_CAP_N))
