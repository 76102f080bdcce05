"""`crosspih cell`."""

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator"
COMMANDS = {
    "check": OnDemand(
        f"{_HERE}.cell.check.command:check",
        "What is wrong with a cell, and how to mend it: moves little and gently. Status 1 when something is wrong.",
        example="--cell deploy/cells/default.yaml",
    ),
    "init": OnDemand(
        f"{_HERE}.cell.init.command:init",
        "Make a cell's file by answering questions; each answer is checked at once.",
        example="my-cell.yaml",
    ),
    "drivers": OnDemand(
        f"{_HERE}.cell.drivers:drivers",
        "List the drivers of devices, crosspih's own and those of installed packages, and what each still needs.",
    ),
    "practise": OnDemand(
        f"{_HERE}.bench.protocols.commands.practise:practise",
        "A UR5e, an ATI sensor and two cameras without any of them: their other ends speak the devices' "
        "protocols at the addresses of docs/hardware/in-a-day.md, in a network of its own, and the cell "
        "behind them is not as its file says. Without a terminal and a command it stays until it is ended.",
        settings={"ignore_unknown_options": True},
        example="run/day",
    ),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def cell() -> None:
    """The cell itself."""
