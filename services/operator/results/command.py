"""`crosspih results`: run what is missing, then write the page."""

from __future__ import annotations

import os
import shlex
import subprocess
import tempfile
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import ConfigError, CrosspihError
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.provenance import (
    MEASURED_VARIABLE,
    SourceWatch,
    cell_identity,
    code_version,
    measured_in,
    part_version,
    result_key,
)
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.local_executor import usable_cores
from services.operator.bench.cells.own_cell import free_port
from services.operator.bench.cells.pool import ExecutorName
from services.operator.bench.cells.stopping import stopped_in_order
from services.operator.bench.options import Cells, RayAddress, Where
from services.operator.cli.time_left import in_words
from services.operator.results.page import SectionCounts, make_page, when
from services.operator.results.plan import PLAN, PlannedSection, arguments, load_plan
from services.operator.results.printed import Printed, PrintedFolder

WIDTH = 118


def _environment(told: Path) -> dict[str, str]:
    """The environment of a command: the default cell, on a separate port, so that no other running stack answers."""
    mine = {name: value for name, value in os.environ.items() if name not in ("CROSSPIH_CELL", "CROSSPIH_ENDPOINT")}
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    return {**mine, "COLUMNS": str(WIDTH), MEASURED_VARIABLE: str(told), "CROSSPIH_ENDPOINT": endpoint}


def _run(command: str, environment: dict[str, str]) -> tuple[int, str]:
    """Run a command and pass on its standard error; returns its status and its standard output."""
    with subprocess.Popen(arguments(command), stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        try:
            text = process.stdout.read()
        except KeyboardInterrupt:
            # the command stops its cells and reports its progress; Ctrl-C in a terminal has reached it too, which does
            # no harm
            process.terminate()
            process.wait()
            raise
        return process.wait(), text


def _make(entry: PlannedSection, command: str, where: tuple[str, ...], json_path: Path, cell: str) -> Printed:
    with tempfile.TemporaryDirectory(prefix="crosspih-results-") as folder:
        told = Path(folder) / "measured"
        started = time.monotonic()
        # the executor does not change the results, so it is not part of the command that the page shows
        status, text = _run(shlex.join([*shlex.split(command), *where]), _environment(told))
        elapsed_s = time.monotonic() - started
        measured = measured_in(told)
        if status == 0 and entry.has_json:
            again = Path(folder) / "printed-again"
            status, content = _run(shlex.join([*shlex.split(command), *where, "--json"]), _environment(again))
            json_path.parent.mkdir(parents=True, exist_ok=True)
            json_path.write_text(content, encoding="utf-8")
    return Printed(
        name=entry.name, command=command, code=code_version(), cores=usable_cores(), status=status,
        elapsed_s=round(elapsed_s, 1), text=text, cell=cell,
        shown_by=part_version("services.operator"), at=datetime.now(timezone.utc).isoformat("T", "seconds"),
        **measured.model_dump(),
    )  # fmt: skip


def _default_cell() -> str:
    text = Path(DEFAULT_CELL).read_text(encoding="utf-8")
    return result_key(cell_identity(cell_content(text, Condition())))


def entries_named(entries: list[PlannedSection], names: list[str]) -> list[PlannedSection]:
    """The entries with that name, or with a name that begins with it: peg, or peg-star, for all of them."""

    def means(name: str, entry: PlannedSection) -> bool:
        return entry.name == name or entry.name.startswith(f"{name}-")

    for name in names:
        if not any(means(name, entry) for entry in entries):
            known = ", ".join(entry.name for entry in entries)
            raise ConfigError(f"{name}: no such result; want some of {known}, or how their names begin, as in peg")
    # a full name means only its own entry: refine is not refine-far
    exact = {entry.name for entry in entries}
    return [
        entry
        for entry in entries
        if not names or any(entry.name == name if name in exact else means(name, entry) for name in names)
    ]


def _how_far(done: int, count: int, took_s: list[float | None]) -> str:
    """The position of the entry, and how long it and those after it took the last time."""
    known = [one for one in took_s if one is not None]
    rest = f", about {in_words(sum(known))} left by the last time" if known else ""
    unknown = f", {len(took_s) - len(known)} of them never ran here" if known and len(known) < len(took_s) else ""
    return f"{done + 1} of {count}{rest}{unknown}"


def results(
    names: Annotated[
        list[str] | None, typer.Argument(help="Only these, or those whose names begin so; all when none is named.")
    ] = None,
    plan: Annotated[Path, typer.Option(help="The list of commands.")] = PLAN,
    page: Annotated[Path, typer.Option(help="Where the page goes; its pictures go beside it, in results/.")] = Path(
        "docs/results.md"
    ),
    kept: Annotated[Path, typer.Option(help="Where what was printed is kept.")] = Path("results/printed"),
    again: Annotated[bool, typer.Option("--again", help="Run them even if the code is the same as last time.")] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Small runs, into results/quick: do all commands work?")
    ] = False,
    cells: Cells = None,
    executor: Where = ExecutorName.LOCAL,
    ray_address: RayAddress = None,
    page_only: Annotated[bool, typer.Option("--page-only", help="Run nothing, only write the page.")] = False,
) -> None:
    """Make docs/results.md: run every command whose result is missing or of other code, and write down what it said."""
    console = Console(stderr=True)
    failed: list[str] = []
    try:
        entries = load_plan(plan)
        chosen = entries_named(entries, names or [])
        if quick:
            page, kept = Path("results/quick/results.md"), Path("results/quick/printed")
        folder, code = page.parent / "results", code_version()
        folder.mkdir(parents=True, exist_ok=True)
        shelf = PrintedFolder(kept)
        where: tuple[str, ...] = () if cells is None else ("--cells", str(cells))
        if executor is not ExecutorName.LOCAL:
            where += ("--executor", executor.value)
        if ray_address is not None:
            where += ("--ray-address", ray_address)

        def write() -> SectionCounts:
            printed = {entry.name: found for entry in entries if (found := shelf.get(entry.name)) is not None}
            before = page.read_text(encoding="utf-8") if page.is_file() else ""
            text, counts = make_page(entries, printed, folder.as_posix(), code, before, quick)
            page.write_text(text, encoding="utf-8")
            return counts

        counts, watch, cell = write(), SourceWatch(), _default_cell()
        if os.environ.get("CROSSPIH_CELL") and not page_only:
            console.print("CROSSPIH_CELL is passed over: the page is about the default cell", style="yellow")
        for number, entry in enumerate([] if page_only else chosen):
            command = entry.shown(folder.as_posix(), tuple(entry.quick.split()) if quick else ())
            before = shelf.get(entry.name)
            # commands with a store print again in seconds when the operator's own code makes other tables of their
            # results
            shown = before is not None and (before.shown_by == part_version("services.operator") or not entry.in_cells)
            if before is not None and shown and before.stands_for(command, code, cell) and not again:
                console.print(f"{entry.name}: known", highlight=False)
                continue
            console.print(f"{entry.name}: {command}", style="bold", markup=False, highlight=False, soft_wrap=True)
            took = [None if (was := shelf.get(one.name)) is None else was.elapsed_s for one in chosen[number:]]
            console.print(_how_far(number, len(chosen), took), style="dim", highlight=False)
            with stopped_in_order():
                printed = _make(entry, command, where if entry.in_cells else (), folder / f"{entry.name}.json", cell)
            if not watch.unchanged():
                raise CrosspihError(
                    f"{entry.name}: the sources changed while it ran, so that it is of no one code and is not kept; "
                    f"leave them alone, and give the same command again"
                )
            shelf.put(printed)
            counts = write()
            if printed.status != 0:
                failed.append(entry.name)
            console.print(f"{entry.name}: {when(printed)}", highlight=False)
    except CrosspihError as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print("stopped; the same command goes on from here", highlight=False)
        raise typer.Exit(130) from None
    console.print(f"{page} is written: {counts.said(code)}", highlight=False)
    if failed:
        console.print(f"failed: {', '.join(failed)}", style="red", highlight=False)
        raise typer.Exit(1)
