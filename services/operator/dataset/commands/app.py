"""`crosspih dataset`: contacts with known pose errors, collected in cells or made by the mechanics, as Parquet."""

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.dataset.commands"
COMMANDS = {
    "collect": OnDemand(
        f"{_HERE}.collect:collect",
        "Push the peg against the hole at drawn pose errors and keep what is felt, each sample with its pose, state, "
        "seed.",
        by_cell=True,
        example="--poses 20 --out run/contacts",
    ),
    "synthesise": OnDemand(
        f"{_HERE}.synthesise:synthesise",
        "Single contacts of the cell's peg, made by the mechanics: thousands a second, no cell needed.",
        example="--out run/made",
    ),
    "show": OnDemand(f"{_HERE}.describe:describe", "Print what is in a data set of contacts.", example="run/contacts"),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def dataset() -> None:
    """Contacts with known pose errors, as Parquet."""
