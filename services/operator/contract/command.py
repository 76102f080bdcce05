"""`crosspih keys`: the key space, straight from its one table."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.keys import ROOT, commands, topics
from services.operator.contract.keys_table import HEADINGS, markdown, rows


def keys(
    as_markdown: Annotated[bool, typer.Option("--markdown", help="As docs/keys.md has it.")] = False,
    schema: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write JSON Schema of every message there, and an index.")
    ] = None,
) -> None:
    """Print every key: what travels, who sends it, who reads it."""
    if schema is not None:
        _write(schema)
        return
    if as_markdown:
        print(markdown(), end="")
        return
    table = Table(title=f"{ROOT}/<cell>/…", title_justify="left")
    for name in HEADINGS:
        table.add_column(name, no_wrap=name == "key")
    for row in rows():
        table.add_row(*row)
    Console().print(table)


def _write(folder: Path) -> None:
    from services.operator.contract.schema import write_schemas

    try:
        written = write_schemas(folder)
    except OSError as error:
        print(f"--schema {folder}: cannot be written ({error.strerror or error}); name another folder", file=sys.stderr)
        raise typer.Exit(1) from None
    for path in written:
        print(path)
    print(f"{len(written) - 1} types and the index of {len(list(commands())) + len(list(topics()))} keys")
