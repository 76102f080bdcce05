"""`crosspih bench inference`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.inference import PROGRAM, InferenceResult, table_of
from services.operator.bench.speed.measured_by import measured_by


def inference(
    rounds: Annotated[int, typer.Option(min=1, max=100, help="Rounds, in turn; the least of each counts.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the touches that are estimated from.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Measure what each answer of the inference service costs beside the contact mechanics in it, asked alone."""
    console = Console(stderr=True)
    with errors_shown(console):
        words = ("--rounds", str(rounds), "--seed", str(seed))
        costs = measured_by(PROGRAM, "bench inference", *words, console=console)
        result = InferenceResult(costs=costs)
        if as_json:
            print(result.model_dump_json())
        else:
            Console().print(table_of(result))
