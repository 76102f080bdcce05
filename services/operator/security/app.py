"""The commands `crosspih security …`."""

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.security"
COMMANDS = {
    "init": OnDemand(
        f"{_HERE}.command:init",
        "Make an authority, and a certificate and a key for each service.",
        example="--folder certificates --host cell.local",
    ),
    "show": OnDemand(
        f"{_HERE}.command:show",
        "Which certificates there are, and when they end; exit status 1 where one of them cannot be used.",
        example="--folder certificates",
    ),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def security() -> None:
    """Certificates: who may do what in a cell (docs/security.md)."""
