"""`crosspih cell drivers`: which drivers there are, what they open, and what to install."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosspih_common.errors import ConfigError
from services.operator.bench.options import AsJson, errors_shown
from services.operator.other_services.beside import run_module


def installed_drivers() -> list[dict[str, Any]]:
    """The output of `python -m services.hardware.drivers`. Raises ConfigError where the hardware service is not
    installed.
    """
    said = run_module("services.hardware.drivers")
    if not isinstance(said.value, list):
        raise ConfigError(f"the drivers cannot be listed: {said.words}; is crosspih[hardware] installed?")
    return said.value


def drivers(as_json: AsJson = False) -> None:
    """List the drivers of devices, crosspih's own and those of installed packages, and what each still needs."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        found = installed_drivers()
        if as_json:
            json.dump(found, sys.stdout, indent=1)
            print()
            return
        table = Table("driver", "of", "opens", "usable", "what it needs", show_lines=False)
        for one in found:
            opens = ", ".join(one["opens"]) or "does not tell"
            usable = "[green]yes[/green]" if one["usable"] else "[bold red]no[/bold red]"
            table.add_row(one["name"], one["package"], opens, usable, escape(one["missing"]))
        console.print(table)
        console.print('hardware.driver takes a name, or your own "module:function" (docs/own-hardware.md)')
