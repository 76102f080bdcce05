"""docs/cli.md, made from the table of commands: `python -m services.operator.cli.page > docs/cli.md`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from crosspih_common.modules import ROOT
from services.operator.cli.commands import app
from services.operator.cli.on_demand import PROGRAM, OnDemand

HEAD = """# The command line

Made by `python -m services.operator.cli.page` from the table of commands; a test holds it to that table.

Every command says the same with `--help`. `crosspih --version` tells versions, `crosspih --install-completion` makes
the shell complete commands, options and names of topics (bash, zsh, fish). A command that fails says why in one line on
standard error and ends with status 1, with 2 where it cannot be asked so; with `--json` it also prints
`{"error": {"code", "text", "field", "mend"}}` on standard output. `CROSSPIH_ENDPOINT`, `CROSSPIH_CELL`,
`CROSSPIH_DATA` and `CROSSPIH_RUN_DIR` name the router, the cell's file, and the folders for data and for stacks.
"""


@dataclass(frozen=True, slots=True)
class ListedCommand:
    """A command of the table, how it is called, and the heading under which it stands."""

    path: tuple[str, ...]
    entry: OnDemand
    command: TyperCommand
    panel: str


def every_command() -> Iterator[ListedCommand]:
    """All commands that can be run, in the table's order; groups are expanded."""
    root = get_command(app)
    assert isinstance(root, TyperGroup)
    yield from _below(root, (PROGRAM,), "")


def _below(group: Any, path: tuple[str, ...], panel: str) -> Iterator[ListedCommand]:
    for name, entry in group.table.items():
        command = entry.load(name, " ".join((*path, name)))
        under = panel or entry.panel
        if isinstance(command, TyperGroup):
            yield from _below(command, (*path, name), under)
        else:
            yield ListedCommand((*path, name), entry, command, under)


def _option_rows(command: TyperCommand) -> Iterator[str]:
    context = command.context_class(command, info_name=command.name)
    for parameter in command.params:
        found: Any = parameter
        if getattr(found, "hidden", False):
            continue
        record = found.get_help_record(context)
        if record is None:
            continue
        names, said = record
        names, said = (_everywhere(" ".join(text.split())).replace("|", "\\|") for text in (names, said))
        yield f"| `{names}` | {said} |"


def _everywhere(text: str) -> str:
    """The text without details of this machine."""
    return text.replace(f"{ROOT}/", "").replace("[env var: ", "[environment: ")


def markdown() -> str:
    """The page."""
    lines, panel = [HEAD], ""
    for one in every_command():
        if one.panel != panel:
            panel = one.panel
            lines += [f"## {panel}", ""]
        title = " ".join(one.path)
        lines += [f"### {title}", ""]
        paragraphs = re.split(r"\n\s*\n", (one.command.help or "").strip())
        for paragraph in paragraphs:
            lines += [" ".join(paragraph.split()), ""]
        lines += ["```sh", " ".join(filter(None, (title, one.entry.example))), "```", ""]
        rows = list(_option_rows(one.command))
        if rows:
            lines += ["| argument or option | what it does |", "|---|---|", *rows, ""]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    print(markdown(), end="")
