"""The commands `crosspih peg …`."""

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.peg"
COMMANDS = {
    "list": OnDemand(f"{_HERE}.listing:list_pegs", "The pegs that can be named, and the cell's own.", by_cell=True),
    "check": OnDemand(
        f"{_HERE}.command:check_drawing",
        "Tell what a drawing is read as, and what is left out; exit status 0 only if it can be a peg and its hole.",
        by_cell=True,
        example="docs/drawings/flower.svg",
    ),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def peg() -> None:
    """Pegs by name, and pegs from drawings."""
