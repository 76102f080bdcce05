"""Commands that are imported when they are called: what the lists say, and what printing them loads."""

from __future__ import annotations

import subprocess
import sys

import pytest
from typer.testing import CliRunner

from services.operator.cli.commands import COMMANDS, app

HEAVY = ("numpy", "scipy", "pydantic", "zenoh", "yaml")


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_says_what_the_commands_own_help_says(name: str) -> None:
    command = COMMANDS[name].load(name)
    assert command.name == name
    first, _, _ = (command.help or "").partition("\n\n")
    assert " ".join(first.split()) == COMMANDS[name].says


def test_help_is_printed_by_typer_alone() -> None:
    program = (
        "import sys\n"
        "from services.operator.cli.commands import app\n"
        "try:\n    app(['--help'])\n"
        "except SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert said.stderr.strip() == "[]"
    assert all(name in said.stdout for name in COMMANDS)


def test_a_command_that_is_none_is_named_and_a_near_one_suggested() -> None:
    said = CliRunner().invoke(app, ["benhc"])
    assert said.exit_code == 2 and "benhc" in said.output and "bench" in said.output
