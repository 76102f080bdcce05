"""`crosspih bench hosts`."""

from __future__ import annotations

import json
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from statistics import median, quantiles
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.errors import ConfigError
from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.reliability.hosts.network import NoNetwork, why_not
from services.operator.bench.reliability.hosts.plan import TRIALS, Chosen
from services.operator.bench.reliability.hosts.running import HostTrial, run_on_one_stack

WIDTH = 160


def _ms(values_s: list[float]) -> str:
    if len(values_s) < 2:
        return ""
    return f"{median(values_s) * 1e3:.0f} / {quantiles(values_s, n=20)[-1] * 1e3:.0f}"


def _ahead(row: HostTrial) -> str:
    seen = row.seen
    if seen.wall_ahead_s is None or seen.wall_bound_s is None:
        return ""
    return f"{seen.wall_ahead_s * 1e3:+.0f} ± {seen.wall_bound_s * 1e3:.0f}"


def table_of(rows: list[HostTrial]) -> Table:
    """One line per trial."""
    table = Table(title="the stack on hosts of its own, the cell in real time")
    for name in ("", "ends as", "vision"):
        table.add_column(name)
    for name in (
        "s", "wall, s", "command, ms p50 / p95", "unanswered", "recorded", "missing", "packets lost, cut",
        "arm at rest, s", "clock off, ms",
    ):  # fmt: skip
        table.add_column(name, justify="right")
    table.add_column("events")
    for row in rows:
        seen, rest_s = row.seen, row.kept.rest_s
        table.add_row(
            row.trial, "inserted" if seen.inserted else seen.failure, seen.vision,
            "" if seen.duration_s is None else f"{seen.duration_s:.1f}", f"{seen.wall_s:.1f}", _ms(seen.latencies_s),
            str(seen.unanswered), str(row.kept.samples), str(row.kept.missing),
            f"{row.packets['lost']}, {row.packets['cut']}", "" if rest_s is None else f"{rest_s:.2f}", _ahead(row),
            ", ".join(f"{code} {count}" for code, count in sorted(seen.events.items())),
        )  # fmt: skip
    return table


def hosts(
    trial: Annotated[list[str] | None, typer.Option(help=f"{'; '.join(TRIALS)}. All when left out.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws the hole.")] = 1000,
    keep: Annotated[Path | None, typer.Option(help="A folder in which logs and recordings stay.")] = None,
    as_json: AsJson = False,
) -> None:
    """Assemble with the stack on one host and split over three, which are network namespaces made for it: also over a
    link that is slow and loses packets, one that is cut, and with clocks apart. Needs root, on Linux.
    """
    console = Console(stderr=True)
    with errors_shown(console):
        unknown = [name for name in trial or () if name not in TRIALS]
        if unknown:
            raise ConfigError(f"--trial {', '.join(unknown)}: want one of {'; '.join(TRIALS)}")
        if why := why_not():
            raise NoNetwork(f"no hosts can be made here: {why}")
        chosen = Chosen([one for name, one in TRIALS.items() if not trial or name in trial])
        rows: list[HostTrial] = []

        def say(text: str) -> None:
            console.print(text, highlight=False)

        def done(row: HostTrial) -> None:
            rows.append(row)
            bar.advance(task)
            say(f"{row.trial}: {'inserted' if row.seen.inserted else f'{row.seen.failure} {row.seen.detail}'}")
            for code, text in row.seen.texts.items():
                console.print(f"  {code}: {text}", highlight=False, markup=False)
            for text in row.seen.warnings:
                console.print(f"  recording: {text}", highlight=False, markup=False)

        with Bar(console) as bar, ExitStack() as made:
            task = bar.add_task("assemblies on hosts", total=len(chosen.trials))
            for index, trials in enumerate(chosen.stacks(), 1):
                if keep is None:
                    folder = Path(made.enter_context(tempfile.TemporaryDirectory(prefix="crosspih-hosts-")))
                else:
                    folder = keep.absolute() / f"stack{index}"
                    if folder.exists():
                        raise ConfigError(f"--keep: {folder} is of an earlier run; name another folder")
                    folder.mkdir(parents=True)
                run_on_one_stack(trials, folder, seed, "realtime", say, done)
        if as_json:
            json.dump([row.model_dump(mode="json") for row in rows], sys.stdout, indent=1)
            print()
        else:
            Console(width=WIDTH).print(table_of(rows))
