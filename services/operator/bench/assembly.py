"""`crosspih bench assembly`: many seeds over the running stack."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from crosspih_common.errors import CrosspihError
from crosspih_common.messages import Strategy
from services.operator.scoring import TrialFigures
from services.operator.stack import cell_session
from services.operator.statistics import BenchResult, summarise


def _table(result: BenchResult) -> Table:
    table = Table(
        title=f"{result.strategy}: {result.inserted} of {result.trials} inserted "
        f"(95 % Wilson {result.wilson95_low:.1%} to {result.wilson95_high:.1%}), seeds from {result.seed}"
    )
    table.add_column("figure")
    for name in ("p50", "p95", "max", "n"):
        table.add_column(name, justify="right")
    for name, value in result.figures.items():
        table.add_row(name, f"{value.p50:.3f}", f"{value.p95:.3f}", f"{value.max:.3f}", str(value.count))
    for name, count in result.failures.items():
        table.add_row(f"[red]failed: {name}[/red]", "", "", "", str(count))
    return table


def assembly(
    trials: Annotated[int, typer.Option(min=1, help="How many seeds.")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    record: Annotated[bool, typer.Option(help="Keep a recording of every trial.")] = False,
    speed: Annotated[str, typer.Option(help="realtime or max.")] = "max",
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> None:
    """Assemble with each of N seeds and print the distribution of what came out."""
    console = Console(stderr=True)
    done: list[TrialFigures] = []
    try:
        with cell_session(speed) as (session, _):
            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
            )
            with Progress(*columns, console=console) as progress:
                task = progress.add_task(strategy.value, total=trials)
                for index in range(trials):
                    figures, _ = session.trial(seed + index, strategy, record)
                    done.append(figures)
                    if not figures.inserted:
                        progress.console.print(
                            f"[red]seed {figures.seed}: {figures.failure}[/red] {figures.failure_detail}",
                            highlight=False,
                        )
                    inserted = sum(trial.inserted for trial in done)
                    progress.update(task, advance=1, description=f"{strategy.value}: {inserted} in")
    except CrosspihError as error:
        said = f"bench ended after {len(done)} trials: {error}"
        console.print(said, style="red", markup=False, highlight=False, soft_wrap=True)
        if not done:
            raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print(f"stopped after {len(done)} trials", highlight=False)
        if not done:
            raise typer.Exit(130) from None
    result = summarise(strategy.value, seed, done)
    if as_json:
        json.dump(result.model_dump(), sys.stdout, indent=1)
        print()
    else:
        Console().print(_table(result))
    if len(done) < trials:
        raise typer.Exit(1)
