"""The `crosspih` command: the table of all its commands, and how it starts."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from crosspih_common.modules import not_installed
from crosspih_common.security import CERTIFICATES
from services.operator.cli.on_demand import PROGRAM, OnDemand, group_of

COLUMNS_IN_A_FILE = 120

_HERE = "services.operator"
COMMANDS = {
    "assemble": OnDemand(
        f"{_HERE}.assembly.commands.assemble:assemble",
        "Do one assembly: on the running stack, or on one that is started for it and stopped afterwards.",
        example="--seed 7",
        panel="Run",
    ),
    "withdraw": OnDemand(
        f"{_HERE}.assembly.commands.withdraw:withdraw",
        "Take a seated peg straight out along its own axis, slowly; stop where it resists (status 1).",
        by_cell=True,
        panel="Run",
    ),
    "pause": OnDemand(
        f"{_HERE}.assembly.commands.interrupting:pause",
        "Hold the running assembly: the motion under way is finished, and the arm then stays where it is.",
        by_cell=True,
        panel="Run",
    ),
    "resume": OnDemand(
        f"{_HERE}.assembly.commands.interrupting:resume", "Let a paused assembly go on.", by_cell=True, panel="Run"
    ),
    "stop": OnDemand(
        f"{_HERE}.assembly.commands.interrupting:stop",
        "Stop the arm at once and end the running assembly; the peg is then backed off.",
        by_cell=True,
        panel="Run",
    ),
    "locate": OnDemand(
        f"{_HERE}.locate.command:locate",
        "Where the hole is in a pair of pictures, with no stack running.",
        example="left.png right.png --calibration cameras.yaml",
        panel="Run",
    ),
    "up": OnDemand(
        "deploy.launcher.cli:up",
        "Start the services and show what they write; Ctrl-C stops them all.",
        example="--detach --wait",
        panel="The stack",
    ),
    "ps": OnDemand(
        f"{_HERE}.cli.ps:ps",
        "Show the services, their health and restarts, which have no sign of life on the bus, and whether the clock "
        "here is the cell's; exit status 1 if the stack is not up.",
        panel="The stack",
    ),
    "logs": OnDemand(
        "deploy.launcher.looking:logs",
        "Show what the services of the running, or of the last, stack wrote, in the order of time.",
        example="-f planning",
        panel="The stack",
    ),
    "down": OnDemand(
        "deploy.launcher.cli:down",
        "Stop all services, in order, and the supervisor; say how each of them ended.",
        panel="The stack",
    ),
    "foxglove": OnDemand(
        f"{_HERE}.cli.foxglove:foxglove",
        "Show the running cell in Foxglove or Lichtblick, live, until Ctrl-C: a WebSocket to connect to.",
        example="--port 8765",
        by_cell=True,
        panel="Look",
    ),
    "topic": OnDemand(
        f"{_HERE}.topic.commands:app", "What travels on the bus now: listed, printed, measured.", panel="Look"
    ),
    "keys": OnDemand(
        f"{_HERE}.contract.command:keys", "Print every key: what travels, who sends it, who reads it.", panel="Look"
    ),
    "recording": OnDemand(
        f"{_HERE}.recordings.app:app",
        "Look into recordings, mend, cut, merge, animate and export them.",
        panel="Look",
    ),
    "report": OnDemand(
        f"{_HERE}.report.command:report",
        "Make one self-contained HTML page about a recorded assembly, or about two side by side.",
        example="recordings/assembly-fused-seed7.mcap",
        panel="Look",
    ),
    "view": OnDemand(
        f"{_HERE}.recordings.view.command:view",
        "A recording in the browser, with a time slider: the cell in 3-D, forces, touches, pictures; or two side by "
        "side.",
        example="recordings/assembly-fused-seed7.mcap",
        panel="Look",
    ),
    "replay": OnDemand(
        f"{_HERE}.recordings.replay.command:replay",
        "Have vision, inference, force/torque and planning answer and decide again on what a recording holds, and "
        "compare bit for bit.",
        example="recordings/assembly-fused-seed7.mcap",
        panel="Look",
    ),
    "doctor": OnDemand(
        f"{_HERE}.doctor.command:doctor",
        "Could an assembly start? Looks at machine, cell file, devices and calibrations; moves nothing. Status 1: no.",
        example="--cell deploy/cells/ur5e.yaml",
        panel="Set up",
    ),
    "cell": OnDemand(f"{_HERE}.cell.commands:app", "The cell itself.", panel="Set up"),
    "calibrate": OnDemand(f"{_HERE}.calibrate.commands.app:app", "Calibrations of the cell.", panel="Set up"),
    "peg": OnDemand(f"{_HERE}.peg.app:app", "Pegs by name, and pegs from drawings.", panel="Set up"),
    "security": OnDemand(
        f"{_HERE}.security.app:app",
        "Certificates: who may do what in a cell (docs/security.md).",
        panel="Set up",
    ),
    "bench": OnDemand(
        f"{_HERE}.bench.commands:app", "Measured distributions over seeds that anyone can repeat.", panel="Measure"
    ),
    "results": OnDemand(
        f"{_HERE}.results.command:results",
        "Make docs/results.md: run every command whose result is missing or of other code, and write down what it "
        "said.",
        example="--quick",
        panel="Measure",
    ),
    "dataset": OnDemand(
        f"{_HERE}.dataset.commands.app:app", "Contacts with known pose errors, as Parquet.", panel="Train"
    ),
    "train": OnDemand(
        f"{_HERE}.training.command:train",
        "Train the 6-150-3 network: split by pose, early stopping, a page that judges it against what is possible.",
        example="--data run/contacts --optimiser lm",
        panel="Train",
    ),
}
"""Each is imported when it is called: `crosspih --help` needs Typer alone."""

app = typer.Typer(name=PROGRAM, cls=group_of(COMMANDS), no_args_is_help=True, pretty_exceptions_enable=False)


def _print_version(wanted: bool) -> None:
    if wanted:
        from services.operator.cli.version import version_lines  # depends on the installed packages

        for line in version_lines():
            print(line)
        raise typer.Exit


@app.callback()
def crosspih(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version,
            help="Versions of crosspih, its messages, Python and Zenoh.",
        ),
    ] = False,
) -> None:  # fmt: skip
    """Autonomous peg-in-hole assembly: run it, measure it, look at what happened."""


def main() -> None:
    """The console script."""
    if not sys.stdout.isatty():
        # otherwise tables in a file or a pipe would be cut to 80 columns
        os.environ.setdefault("COLUMNS", str(COLUMNS_IN_A_FILE))
    for variable in ("CROSSPIH_CELL", CERTIFICATES):  # services are started in another folder
        if named := os.environ.get(variable):
            os.environ[variable] = os.path.abspath(named)
    try:
        app(prog_name=PROGRAM)
    except ModuleNotFoundError as error:
        print(f"crosspih: {not_installed(error)}", file=sys.stderr)
        sys.exit(1)
