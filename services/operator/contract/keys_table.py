"""`crosspih keys`: the key space, straight from its one table."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.keys import ROOT, commands, topics

HEADINGS = ("key", "message", "kind", "sent by", "read by", "Hz", "what")


def rows() -> list[tuple[str, ...]]:
    """One row a key, in `HEADINGS` order; the echoes of commands are left out."""
    echoes = {f"{command.path}/{end}" for command in commands() for end in ("request", "reply")}
    table: list[tuple[str, ...]] = [
        (
            topic.path,
            topic.type.__name__,
            topic.kind.value,
            topic.publisher,
            ", ".join(topic.readers),
            "" if topic.rate_hz is None else f"{topic.rate_hz:g}",
            topic.doc,
        )
        for topic in topics()
        if topic.path not in echoes
    ]
    table += [
        (
            command.path,
            f"{command.request.__name__} -> {command.reply.__name__}",
            "command",
            ", ".join(command.callers),
            command.server,
            "",
            command.doc,
        )
        for command in commands()
    ]
    return table


def markdown() -> str:
    """The table as a page of the documentation."""
    lines = [
        "# Keys",
        "",
        f"Every key below `{ROOT}/<cell>/`. Made by `crosspih keys --markdown` from `crosspih_common/keys.py`; a test",
        "holds it to that table. A command is a query on its key; its server repeats what it was asked on",
        "`<key>/request` and what it answered on `<key>/reply`. Beside each payload travels `type/version seq`.",
        "",
        "| " + " | ".join(HEADINGS) + " |",
        "|" + "---|" * len(HEADINGS),
    ]
    lines += ["| " + " | ".join([f"`{row[0]}`", f"`{row[1]}`", *row[2:]]) + " |" for row in rows()]
    return "\n".join(lines) + "\n"


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
