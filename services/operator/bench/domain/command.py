"""`crosspih bench domain`: success over cells that differ from the default in one factor each, as a heat map."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.config import load_cell
from crosspih_common.messages import Strategy
from services.operator.bench.cells.pool import ExecutorName
from services.operator.bench.cells.trials import DEFAULT_STORE, TrialJob
from services.operator.bench.domain.boxes import WANTED, DomainResult, boxes_of, chosen_factors, table_of
from services.operator.bench.domain.factors import factors
from services.operator.bench.domain.heat_map import draw_map
from services.operator.bench.options import AsJson, Cells, RayAddress, Store, Where, errors_shown, trials_of
from services.operator.cell.which_cell import cell_path


def domain(
    trials: Annotated[int, typer.Option(min=1, help="How many seeds a box.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    factor: Annotated[list[str] | None, typer.Option(help="Only this factor; may be named again.")] = None,
    picture: Annotated[Path, typer.Option(help="Where the heat map goes.")] = Path("results/domain.png"),
    cells: Cells = None,
    executor: Where = ExecutorName.LOCAL,
    ray_address: RayAddress = None,
    store: Store = DEFAULT_STORE,
    as_json: AsJson = False,
) -> None:
    """Assemble in cells that differ from the default in one factor each: a heat map of success."""
    console = Console(stderr=True)
    with errors_shown(console):
        cell = load_cell(cell_path())
        chosen = chosen_factors(factors(cell.workcell, cell.sections["hardware"]), factor or ())
        conditions = {}
        for one in chosen:
            for level in one.levels:
                condition = one.condition(level)
                conditions[condition.name] = condition
        jobs = [
            TrialJob(seed=seed + index, strategy=strategy, condition=condition)
            for condition in conditions.values()
            for index in range(trials)
        ]
        done, ended = trials_of(
            console, f"{len(conditions)} cells", jobs, cells=cells, executor=executor, ray_address=ray_address,
            store=store,
        )  # fmt: skip
        if done:
            result = DomainResult(strategy=strategy.value, seed=seed, trials=trials, boxes=boxes_of(chosen, done, seed))
            picture.parent.mkdir(parents=True, exist_ok=True)
            draw_map(result.boxes, result.strategy, result.trials, WANTED, picture)
            if as_json:
                sys.stdout.write(result.model_dump_json(indent=1) + "\n")
            else:
                Console().print(table_of(result))
                Console().print(f"heat map: {picture}", highlight=False)
        if ended is not None:
            raise ended
