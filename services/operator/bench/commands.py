"""`crosspih bench`: measured distributions over seeds that anyone can repeat. One module a command."""

import typer

from services.operator.bench.assembly import assembly
from services.operator.bench.busy import busy
from services.operator.bench.calibrations import calibrations
from services.operator.bench.caps.command import caps
from services.operator.bench.cell import cell
from services.operator.bench.compare import compare
from services.operator.bench.domain import domain
from services.operator.bench.engines import engines
from services.operator.bench.fuzz.command import fuzz
from services.operator.bench.hosts.command import hosts
from services.operator.bench.kills.command import kills
from services.operator.bench.matrix.command import matrix
from services.operator.bench.pictures.command import make_pictures
from services.operator.bench.protocols.assembling import protocols
from services.operator.bench.protocols.day import day
from services.operator.bench.refine import refine
from services.operator.bench.scaling import scaling
from services.operator.bench.sizes import sizes
from services.operator.bench.soak.command import soak
from services.operator.bench.states import states
from services.operator.bench.vision import vision
from services.operator.for_cell import for_cell

app = typer.Typer(no_args_is_help=True, help="Measured distributions over seeds that anyone can repeat.")
app.command()(for_cell(assembly))
app.command()(for_cell(domain))
app.command()(for_cell(scaling))
app.command()(for_cell(states))
app.command()(for_cell(compare))
app.command()(for_cell(vision))
app.command()(for_cell(sizes))
app.command("pictures")(make_pictures)
app.command()(for_cell(refine))
app.command()(engines)
app.command()(protocols)
app.command()(day)
app.command()(cell)
app.command()(for_cell(caps))
app.command()(for_cell(kills))
app.command()(for_cell(matrix))
app.command()(for_cell(soak))
app.command()(for_cell(fuzz))
app.command()(for_cell(busy))
app.command()(for_cell(hosts))
app.command()(for_cell(calibrations))
