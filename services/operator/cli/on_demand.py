"""A group of commands of which only the one that is asked for is imported: help is printed by Typer alone."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group


@dataclass(frozen=True, slots=True)
class OnDemand:
    """Where a command, or a Typer app of several, is found: `package.module:name`; and what the list says of it.

    `says` is the first paragraph of the command's own help: tests/operator/test_on_demand.py holds the two together.
    """

    where: str
    says: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    by_cell: bool = False
    """Whether it goes by a cell's file and has not its own `--cell` yet."""

    def load(self, name: str) -> TyperCommand | TyperGroup:
        """The command itself, which imports all that it needs."""
        module, _, attribute = self.where.partition(":")
        found = getattr(importlib.import_module(module), attribute)
        if isinstance(found, typer.Typer):
            group = get_group(found)
            group.name = name
            return group
        if self.by_cell:
            from services.operator.cli.for_cell import for_cell  # it loads what a cell's file is read by

            found = for_cell(found)
        alone = typer.Typer(add_completion=False, pretty_exceptions_show_locals=False)
        alone.command(name, context_settings=dict(self.settings))(found)
        command = get_command(alone)
        assert isinstance(command, TyperCommand)
        return command


def group_of(table: Mapping[str, OnDemand]) -> type[TyperGroup]:
    """The class of a Typer app, `typer.Typer(cls=...)`, whose commands are those of the table, in its order."""

    class CommandsOnDemand(TyperGroup):
        """Lists without an import, and imports what is called."""

        _listing = False

        def __init__(self, **settings: Any) -> None:
            super().__init__(**settings)
            self.commands = dict.fromkeys(table)  # type: ignore[assignment]  # Typer suggests the nearest of these names

        def list_commands(self, ctx: Any) -> list[str]:
            """Their names."""
            return list(table)

        def get_command(self, ctx: Any, cmd_name: str) -> Any:
            """The command; while help is printed only its name and what the list says of it."""
            entry = table.get(cmd_name)
            if entry is None:
                return None
            if self._listing:
                return TyperCommand(cmd_name, help=entry.says)
            if self.commands[cmd_name] is None:
                self.commands[cmd_name] = entry.load(cmd_name)
            return self.commands[cmd_name]

        def format_help(self, ctx: Any, formatter: Any) -> None:
            """As Typer does it."""
            self._listing = True
            try:
                super().format_help(ctx, formatter)
            finally:
                self._listing = False

    return CommandsOnDemand
