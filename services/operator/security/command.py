"""`crosspih security init` and `crosspih security show`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from crosspih_common.errors import ConfigError
from crosspih_common.security import CERTIFICATES
from crosspih_common.security.access import SERVICES
from deploy.launcher.display import TerminalConsole
from services.operator.cli.options import AsJson

NEEDS = "crosspih security needs the package cryptography: pip install 'crosspih[security]'"
Folder = Annotated[
    Path, typer.Option("--folder", envvar=CERTIFICATES, help="Where they lie; only its owner may look into it.")
]
HERE = Path("certificates")


def _stop(why: str) -> ConfigError:
    return ConfigError(why)


def init(
    folder: Folder = HERE,
    days: Annotated[float, typer.Option("--days", min=0.01, help="Until all of them end.")] = 365.0,
    host: Annotated[
        list[str] | None,
        typer.Option("--host", help="A name or address at which the router is reached; several are possible."),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Make all anew, also where some exist: the old ones become invalid.")
    ] = False,
) -> None:
    """Make an authority, and a certificate and a key for each service."""
    try:
        from services.operator.security.issuing import issue_all
    except ImportError:
        raise _stop(NEEDS) from None
    here = folder.absolute()
    found = sorted(file.name for pattern in ("*.pem", "*.key") for file in here.glob(pattern))
    if found and not overwrite:
        raise _stop(
            f"{here} holds {len(found)} certificates and keys already: nothing was changed; --overwrite makes all anew"
        )
    if here.is_dir() and (other := sorted({file.name for file in here.iterdir()} - set(found))):
        raise _stop(f"{here} holds other things ({other[0]}): name a folder for certificates alone")
    hosts = ("localhost", "127.0.0.1", *(host or ()))
    try:
        ends = issue_all(here, SERVICES, hosts, days)
    except OSError as error:
        raise _stop(f"{error.filename or here}: {error.strerror}") from None
    print(f"{here}: an authority, and a certificate and a key for each of {', '.join(SERVICES)}")
    print(f"they end on {ends:%Y-%m-%d at %H:%M} UTC; the router is at {', '.join(hosts)}")
    print(f"next: export {CERTIFICATES}={here} in every shell, then crosspih up --file deploy/compose.secure.yaml")


def show(
    folder: Folder = HERE,
    as_json: AsJson = False,
) -> None:
    """Which certificates there are, and when they end; exit status 1 where one of them cannot be used."""
    try:
        from services.operator.security.looking import look
    except ImportError:
        raise _stop(NEEDS) from None
    rows = look(folder.absolute(), SERVICES)
    if as_json:
        shown = {"folder": str(folder.absolute()), "certificates": [row.model_dump(mode="json") for row in rows]}
        print(json.dumps(shown))
    else:
        table = Table("certificate", "ends (UTC)", "days left", "", title=str(folder.absolute()), title_justify="left")
        for row in rows:
            ends = f"{row.ends:%Y-%m-%d %H:%M}" if row.ends else ""
            said = f"[red]{row.wrong}[/red]" if row.wrong else row.note or "can be used"
            table.add_row(row.name, ends, "" if row.days_left is None else f"{row.days_left:.1f}", said)
        TerminalConsole(highlight=False).print(table)
    if any(row.wrong for row in rows):
        raise typer.Exit(1)
