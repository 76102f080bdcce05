"""The `crosspih` command."""

from __future__ import annotations

import os
import sys

import typer

from crosspih_common.security import CERTIFICATES
from deploy.launcher.cli import register as register_launcher
from services.operator.assemble import assemble, calibrate_app
from services.operator.bench.commands import app as bench_app
from services.operator.bench.protocols.practise import practise
from services.operator.cell_check.command import cell_app
from services.operator.cell_init.command import init
from services.operator.dataset import app as dataset_app
from services.operator.doctor.command import doctor
from services.operator.drivers import drivers
from services.operator.for_cell import for_cell
from services.operator.keys_table import keys
from services.operator.locate.command import locate
from services.operator.peg_check.command import peg_app
from services.operator.recording import recording_app
from services.operator.replay.cli import replay
from services.operator.report.cli import report
from services.operator.results import results
from services.operator.security.command import app as security_app
from services.operator.signs_of_life import ps
from services.operator.train import train
from services.operator.withdraw import withdraw

COLUMNS_IN_A_FILE = 120

app = typer.Typer(
    name="crosspih",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_show_locals=False,
    help="Autonomous peg-in-hole assembly: run it, measure it, look at what happened.",
)
app.command()(assemble)
app.command()(for_cell(withdraw))
app.add_typer(bench_app, name="bench")
cell_app.command()(init)
cell_app.command()(drivers)
cell_app.command(context_settings={"ignore_unknown_options": True})(practise)
app.add_typer(cell_app, name="cell")
app.add_typer(peg_app, name="peg")
app.command()(doctor)
app.add_typer(calibrate_app, name="calibrate")
app.command()(locate)
app.command()(report)
app.command()(replay)
app.add_typer(recording_app, name="recording")
app.command()(results)
app.add_typer(dataset_app, name="dataset")
app.command()(train)
app.command()(keys)
app.add_typer(security_app, name="security")
register_launcher(app, ps)


def main() -> None:
    """The console script."""
    if not sys.stdout.isatty():
        # into a file or a pipe tables would be cut to 80 columns
        os.environ.setdefault("COLUMNS", str(COLUMNS_IN_A_FILE))
    for variable in ("CROSSPIH_CELL", CERTIFICATES):  # services are started in another folder
        if named := os.environ.get(variable):
            os.environ[variable] = os.path.abspath(named)
    app()


if __name__ == "__main__":
    main()
