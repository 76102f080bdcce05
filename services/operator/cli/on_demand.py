"""A group of commands that imports only the command that is called: Typer alone prints the help."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

from services.operator.cli.failure import (
    Failed,
    failure_of,
    is_shown_whole,
    print_json,
    say,
    usage_failure,
    with_nearest,
)

PROGRAM = "crosspih"
UsageError: Any = typer.BadParameter.__base__  # a Click type that Typer does not export


class OneCommand(TyperCommand):
    """A command that prints every error in one line, and with `--json` also as an object."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As Click does it; an error about an unknown word names the nearest valid one."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            error.message = with_nearest(error.message)
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run it."""
        as_json = bool(ctx.params.get("as_json"))
        try:
            return super().invoke(ctx)
        except Failed as failed:
            if as_json:
                print_json(failed.failure)
            raise
        except (typer.Exit, typer.Abort, UsageError, BrokenPipeError):
            raise
        except Exception as error:
            if is_shown_whole(error):
                raise
            failure = failure_of(error)
            say(failure)
            if as_json:
                print_json(failure)
            raise typer.Exit(1) from None


@dataclass(frozen=True, slots=True)
class OnDemand:
    """Where a command, or a Typer app of several, is found: `package.module:name`; and its line in the list.

    `says` is the first paragraph of the command's own help: tests/operator/cli/test_on_demand.py checks that the two
    agree.
    """

    where: str
    says: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    by_cell: bool = False
    """Whether it goes by a cell's file and has not its own `--cell` yet."""
    example: str = ""
    """The words behind its name in an example of its use, which stands below its help."""
    panel: str = ""
    """The heading under which a list of commands shows it."""

    def load(self, name: str, path: str = "") -> TyperCommand | TyperGroup:
        """The command itself; this imports all that it needs. `path`: how it is called, for its example."""
        module, _, attribute = self.where.partition(":")
        found = getattr(importlib.import_module(module), attribute)
        if isinstance(found, typer.Typer):
            group = get_group(found)
            group.name = name
            return group
        if self.by_cell:
            from services.operator.cli.for_cell import for_cell  # it imports the reader of a cell's file

            found = for_cell(found)
        alone = typer.Typer(add_completion=False, pretty_exceptions_show_locals=False)
        shown = f"Example: {' '.join(filter(None, (path or name, self.example)))}"
        alone.command(name, cls=OneCommand, context_settings=dict(self.settings), epilog=shown)(found)
        command = get_command(alone)
        assert isinstance(command, TyperCommand)
        return command


def _called(ctx: Any) -> str:
    """How a user who has installed crosspih calls a group."""
    return PROGRAM + str(ctx.command_path).removeprefix(ctx.find_root().command_path)


def group_of(commands: Mapping[str, OnDemand]) -> type[TyperGroup]:
    """The class for `typer.Typer(cls=...)` whose commands are those of a table, in its order."""

    class CommandsOnDemand(TyperGroup):
        """Lists commands without an import, and imports the one that is called."""

        table = commands
        _listing = False

        def __init__(self, **settings: Any) -> None:
            super().__init__(**settings)
            self.commands = dict.fromkeys(commands)  # type: ignore[assignment]  # Typer suggests the nearest of these names

        def list_commands(self, ctx: Any) -> list[str]:
            """Their names."""
            return list(commands)

        def get_command(self, ctx: Any, cmd_name: str) -> Any:
            """The command; while help or a completion is printed, only its name and its line in the list."""
            entry = commands.get(cmd_name)
            if entry is None:
                return None
            if self._listing:
                return TyperCommand(cmd_name, help=entry.says, rich_help_panel=entry.panel or None)
            if self.commands[cmd_name] is None:
                self.commands[cmd_name] = entry.load(cmd_name, f"{_called(ctx)} {cmd_name}")
            return self.commands[cmd_name]

        def format_help(self, ctx: Any, formatter: Any) -> None:
            """As Typer does it."""
            self._listing = True
            try:
                super().format_help(ctx, formatter)
            finally:
                self._listing = False

        def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
            """As Typer does it: completing a command's name imports none of them."""
            self._listing = True
            try:
                return super().shell_complete(ctx, incomplete)
            finally:
                self._listing = False

        def main(
            self, args: Sequence[str] | None = None, prog_name: str | None = None, complete_var: str | None = None,
            standalone_mode: bool = True, windows_expand_args: bool = True, **extra: Any,
        ) -> Any:  # fmt: skip
            """As Typer does it; an invalid command line is with `--json` also an object."""
            words = list(sys.argv[1:] if args is None else args)
            alone = standalone_mode and "--json" in words
            try:
                status = super().main(
                    args, prog_name, complete_var, standalone_mode and not alone, windows_expand_args, **extra
                )
            except UsageError as error:
                if not alone:
                    raise
                from typer.rich_utils import rich_format_error

                rich_format_error(error)
                print_json(usage_failure(error))
                sys.exit(error.exit_code)
            except typer.Abort:
                if not alone:
                    raise
                sys.exit(1)
            if alone:
                sys.exit(status if isinstance(status, int) else 0)
            return status

    return CommandsOnDemand
