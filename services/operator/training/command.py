"""`crosspih train`: the paper's network trained on a data set of contacts, or on the ten rows that the paper prints."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from services.operator.bench.options import errors_shown
from services.operator.other_services.inference_process import run_tool

ANGLES = ("alpha", "beta", "gamma")


class OptimiserChoice(str, Enum):
    """How the weights are found."""

    TRAINGDX = "traingdx"
    ADAM = "adam"
    LBFGS = "lbfgs"
    LM = "lm"


def train(
    data: Annotated[Path, typer.Option(help="A data set that `crosspih dataset collect` or `synthesise` made.")] = Path(
        "run/contacts"
    ),
    paper_rows: Annotated[
        bool, typer.Option("--paper-rows", help="The paper's ten rows instead: in-sample, and each left out.")
    ] = False,
    weights: Annotated[
        Path, typer.Option(help="Where the weights go; the cell's file names them as inference.weights.")
    ] = Path("run/network.safetensors"),
    report: Annotated[Path, typer.Option(help="The page about it.")] = Path("run/training.html"),
    optimiser: Annotated[OptimiserChoice, typer.Option(help="traingdx is the paper's; lm is best on small nets.")] = (
        OptimiserChoice.TRAINGDX
    ),
    hidden: Annotated[int, typer.Option(min=1, max=4000, help="Hidden neurons.")] = 150,
    epochs: Annotated[int, typer.Option(min=1, help="At most.")] = 1000,
    goal: Annotated[float, typer.Option(min=0.0, help="Mean square error, outputs scaled to 0..1, to stop at.")] = 1e-3,
    patience: Annotated[
        int | None, typer.Option(min=1, help="Epochs without a better validation error to stop after.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the split and of the first weights.")] = 1,
    floor_contacts: Annotated[
        int, typer.Option(min=0, help="Contacts made by the mechanics to find the floor with; 0: none.")
    ] = 40_000,
) -> None:
    """Train the 6-150-3 network: split by pose, early stopping, a page that judges it against what is possible."""
    console = Console(stderr=True)
    numbers: dict[str, Any] = {"optimiser": optimiser.value, "hidden": hidden, "epochs": epochs, "goal": goal}
    if patience is not None:
        numbers["patience"] = patience
    numbers["seed"] = seed
    options = [word for name, value in numbers.items() for word in (f"--{name}", str(value))]
    with errors_shown(console):
        if paper_rows:
            result = run_tool(["train", "--paper-rows", *options], console)
            Console().print(_rows_table(result))
            _say_doubts(result)
        else:
            command = " ".join(["crosspih train", "--data", str(data), *options])
            result = run_tool(
                [
                    "train", "--data", str(data), "--out", str(weights), "--command", command,
                    "--floor-contacts", str(floor_contacts), *options,
                ],
                console,
            )  # fmt: skip
            Console().print(_table(result))
            _say_doubts(result)
        # matplotlib takes time to load: other commands should not wait for it
        from services.operator.training.page import write_training_report

        write_training_report(result, report)
    console.print(f"page: {report}" + ("" if paper_rows else f"   weights: {weights}"), highlight=False)


def _say_doubts(result: dict[str, Any]) -> None:
    """Print doubts below the table, where they are seen."""
    for doubt in result["doubts"]:
        Console().print(doubt, style="red", markup=False, highlight=False)


def _cells(values: list[float]) -> list[str]:
    return [f"{value:.2f}" for value in values]


def _table(result: dict[str, Any]) -> Table:
    record, curves = result["record"], result["curves"]
    table = Table(
        title=f"6-{result['hidden']}-3 by {result['optimiser']}: {record['epochs']} epochs, kept epoch "
        f"{curves['best']} ({curves['stopped']}); RMS / p95, degrees"
    )
    table.add_column("")
    table.add_column("contacts", justify="right")
    for name in ANGLES:
        table.add_column(name, justify="right")
    for name, part in result["parts"].items():
        figures = part["network"]
        pairs = zip(_cells(figures["rms_deg"]), _cells(figures["p95_deg"]), strict=True)
        table.add_row(name, str(part["samples"]), *(f"{rms} / {p95}" for rms, p95 in pairs))
    test = result["parts"]["test"]
    for name, key in (("test, guessing the mean", "mean"), ("test, nearest contacts", "nearest_training_contacts")):
        pairs = zip(_cells(test[key]["rms_deg"]), _cells(test[key]["p95_deg"]), strict=True)
        table.add_row(name, "", *(f"{rms} / {p95}" for rms, p95 in pairs))
    if result["floor"] is not None:
        table.add_row(
            "floor, from the mechanics", str(result["floor"]["contacts"]), *_cells(result["floor"]["rms_deg"])
        )
    return table


def _rows_table(result: dict[str, Any]) -> Table:
    table = Table(title="the paper's ten rows: RMS / largest error, degrees")
    table.add_column("")
    for name in ANGLES:
        table.add_column(name, justify="right")
    for name, key in (
        ("in the sample, as in the paper", "in_sample"), ("each by the nine others", "leave_one_out"),
        ("mean of the nine others", "mean_of_the_others"),
    ):  # fmt: skip
        pairs = zip(_cells(result[key]["rms_deg"]), _cells(result[key]["max_deg"]), strict=True)
        table.add_row(name, *(f"{rms} / {largest}" for rms, largest in pairs))
    least, most = (_cells(result[f"leave_one_out_rms_{name}_deg"]) for name in ("least", "most"))
    table.add_row(
        f"RMS of {result['leave_one_out_networks']} networks, least to most",
        *(f"{low} to {high}" for low, high in zip(least, most, strict=True)),
    )
    return table
