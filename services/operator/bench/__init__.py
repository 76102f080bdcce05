"""`crosspih bench`: measured distributions over seeds that anyone can repeat. One module a command."""

import typer

from services.operator.bench.assembly import assembly

app = typer.Typer(no_args_is_help=True, help="Measured distributions over seeds that anyone can repeat.")
app.command()(assembly)
