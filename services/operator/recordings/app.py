"""The commands `crosspih recording …`."""

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.recordings"
_FILE = "recordings/assembly-fused-seed7.mcap"
COMMANDS = {
    "info": OnDemand(
        f"{_HERE}.commands:info", "What is in it: files, channels, rates, times, what is missing.", example=_FILE
    ),
    "check": OnDemand(
        f"{_HERE}.commands:check",
        "Is it whole? Its checks, counts, gaps, stamps, and whether all decodes. Status 1 where something is wrong.",
        example=_FILE,
    ),
    "recover": OnDemand(
        f"{_HERE}.commands:recover",
        "Write all that is whole of a torn or damaged recording, before and behind the damage, as a whole one.",
        example="torn.mcap whole.mcap",
    ),
    "cut": OnDemand(
        f"{_HERE}.commands:cut",
        "Write a piece of a recording, and before it the states that were known then.",
        example=f"{_FILE} piece.mcap --from 4 --to 9",
    ),
    "merge": OnDemand(
        f"{_HERE}.commands:merge",
        "Write several recordings, or the parts of one, as one file in the order of the cell's time.",
        example="first.mcap second.mcap --output both.mcap",
    ),
    "animate": OnDemand(
        f"{_HERE}.animating.command:animate",
        "Make a moving picture of a recorded assembly: the arm, peg and hole from near, and the forces running along.",
        example=_FILE,
    ),
    "export": OnDemand(f"{_HERE}.export.commands:app", "Recordings for other programs."),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def recording() -> None:
    """Look into recordings, mend, cut, merge, animate and export them."""
