"""The `crosspih` command: the table of all it can be asked, and how it starts."""

from __future__ import annotations

import os
import sys

import typer

from crosspih_common.modules import not_installed
from crosspih_common.security import CERTIFICATES
from services.operator.cli.on_demand import OnDemand, group_of

COLUMNS_IN_A_FILE = 120

_HERE = "services.operator"
COMMANDS = {
    "assemble": OnDemand(
        f"{_HERE}.assembly.commands.assemble:assemble",
        "Do one assembly: on the running stack, or on one that is started for it and stopped afterwards.",
    ),
    "withdraw": OnDemand(
        f"{_HERE}.assembly.commands.withdraw:withdraw",
        "Take a seated peg straight out along its own axis, slowly; stop where it resists (status 1).",
        by_cell=True,
    ),
    "pause": OnDemand(
        f"{_HERE}.assembly.commands.interrupting:pause",
        "Hold the running assembly: the motion under way is finished, and the arm then stays where it is.",
        by_cell=True,
    ),
    "resume": OnDemand(f"{_HERE}.assembly.commands.interrupting:resume", "Let a paused assembly go on.", by_cell=True),
    "stop": OnDemand(
        f"{_HERE}.assembly.commands.interrupting:stop",
        "Stop the arm at once and end the running assembly; the peg is then backed off.",
        by_cell=True,
    ),
    "bench": OnDemand(f"{_HERE}.bench.commands:app", "Measured distributions over seeds that anyone can repeat."),
    "cell": OnDemand(f"{_HERE}.cell.commands:app", "The cell itself."),
    "peg": OnDemand(f"{_HERE}.peg.command:peg_app", "Pegs from drawings."),
    "doctor": OnDemand(
        f"{_HERE}.doctor.command:doctor",
        "Could an assembly start? Looks at machine, cell file, devices and calibrations; moves nothing. Status 1: no.",
    ),
    "calibrate": OnDemand(f"{_HERE}.calibrate.commands.app:app", "Calibrations of the cell."),
    "locate": OnDemand(
        f"{_HERE}.locate.command:locate", "Where the hole is in a pair of pictures, with no stack running."
    ),
    "report": OnDemand(
        f"{_HERE}.report.command:report",
        "Make one self-contained HTML page about a recorded assembly, or about two side by side.",
    ),
    "replay": OnDemand(
        f"{_HERE}.recordings.replay.command:replay",
        "Have vision, inference, force/torque and planning answer and decide again on what a recording holds, and "
        "compare bit for bit.",
    ),
    "recording": OnDemand(
        f"{_HERE}.recordings.commands:recording_app", "Look into recordings, mend, cut, merge, animate and export them."
    ),
    "results": OnDemand(
        f"{_HERE}.results.command:results",
        "Make docs/results.md: run every command whose result is missing or of other code, and write down what it "
        "said.",
    ),
    "dataset": OnDemand(f"{_HERE}.dataset.commands.app:app", "Contacts with known pose errors, as Parquet."),
    "train": OnDemand(
        f"{_HERE}.training.command:train",
        "Train the 6-150-3 network: split by pose, early stopping, a page that judges it against what is possible.",
    ),
    "keys": OnDemand(f"{_HERE}.contract.command:keys", "Print every key: what travels, who sends it, who reads it."),
    "security": OnDemand(
        f"{_HERE}.security.command:app", "Certificates: who may do what in a cell (docs/security.md)."
    ),
    "foxglove": OnDemand(
        f"{_HERE}.cli.foxglove:foxglove",
        "Show the running cell in Foxglove or Lichtblick, live, until Ctrl-C: a WebSocket to connect to.",
        by_cell=True,
    ),
    "up": OnDemand("deploy.launcher.cli:up", "Start the services and show what they write; Ctrl-C stops them all."),
    "ps": OnDemand(
        f"{_HERE}.cli.ps:ps",
        "Show the services, their health and restarts, which have no sign of life on the bus, and whether the clock "
        "here is the cell's; exit status 1 if the stack is not up.",
    ),
    "logs": OnDemand(
        "deploy.launcher.looking:logs",
        "Show what the services of the running, or of the last, stack wrote, in the order of time.",
    ),
    "down": OnDemand("deploy.launcher.cli:down", "Stop all services, in order, and the supervisor."),
}
"""Each is imported when it is called: `crosspih --help` needs Typer alone."""

app = typer.Typer(
    name="crosspih",
    cls=group_of(COMMANDS),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_show_locals=False,
)


@app.callback()
def crosspih() -> None:
    """Autonomous peg-in-hole assembly: run it, measure it, look at what happened."""


def main() -> None:
    """The console script."""
    if not sys.stdout.isatty():
        # into a file or a pipe tables would be cut to 80 columns
        os.environ.setdefault("COLUMNS", str(COLUMNS_IN_A_FILE))
    for variable in ("CROSSPIH_CELL", CERTIFICATES):  # services are started in another folder
        if named := os.environ.get(variable):
            os.environ[variable] = os.path.abspath(named)
    try:
        app()
    except ModuleNotFoundError as error:
        print(f"crosspih: {not_installed(error)}", file=sys.stderr)
        sys.exit(1)
