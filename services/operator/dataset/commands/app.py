"""`crosspih dataset`: contacts with known pose errors, collected in cells or made by the mechanics, as Parquet."""

import typer

from services.operator.cli.for_cell import for_cell
from services.operator.dataset.commands.collect import collect
from services.operator.dataset.commands.describe import describe
from services.operator.dataset.commands.synthesise import synthesise

app = typer.Typer(no_args_is_help=True, help="Contacts with known pose errors, as Parquet.")
app.command()(for_cell(collect))
app.command()(synthesise)
app.command("show")(describe)
