"""`crosspih calibrate`. One module a kind of measurement."""

import typer

from services.operator.calibrate.commands.ft import ft
from services.operator.calibrate.commands.pictures import board, hand_eye, stereo
from services.operator.calibrate.commands.pushes import mount, stiffness, tcp
from services.operator.calibrate.commands.refine import refine

app = typer.Typer(no_args_is_help=True, help="Calibrations of the cell.")
app.command()(ft)
app.command()(refine)
app.command()(board)
app.command()(stereo)
app.command("hand-eye")(hand_eye)
app.command()(stiffness)
app.command()(mount)
app.command()(tcp)
