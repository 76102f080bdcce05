"""`crosspih bench`: measured distributions over seeds that anyone can repeat. One module a command."""

import typer

from services.operator.bench.assembly import assembly
from services.operator.bench.busy import busy
from services.operator.bench.caps.command import caps
from services.operator.bench.compare import compare
from services.operator.bench.domain import domain
from services.operator.bench.engines import engines
from services.operator.bench.kills.command import kills
from services.operator.bench.refine import refine
from services.operator.bench.scaling import scaling
from services.operator.bench.states import states
from services.operator.bench.vision import vision

app = typer.Typer(no_args_is_help=True, help="Measured distributions over seeds that anyone can repeat.")
app.command()(assembly)
app.command()(domain)
app.command()(scaling)
app.command()(states)
app.command()(compare)
app.command()(vision)
app.command()(refine)
app.command()(engines)
app.command()(caps)
app.command()(kills)
app.command()(busy)
