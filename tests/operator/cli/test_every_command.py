"""All commands of the table: what they say of themselves, how they fail, and the page that is made of them."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.operator.cli.commands import COMMANDS, app
from services.operator.cli.failure import TRACEBACK, failure_of, with_nearest
from services.operator.cli.page import ListedCommand, every_command, markdown

# of the others among the benches, and of `cell drivers`, what could fail does so after seconds of work
FAIL_AT_ONCE = {"bench assembly", "bench compare", "bench domain", "bench soak"}
SAY_IT_THEMSELVES = {"doctor", "security show"}  # what is wrong is what they are asked: rows of their own object


def _name(one: ListedCommand) -> str:
    return " ".join(one.path[1:])


@pytest.fixture(scope="module")
def every() -> list[ListedCommand]:
    """All commands. Loaded once, and not while tests are collected."""
    return list(every_command())


@pytest.fixture(scope="module")
def with_json(every: list[ListedCommand]) -> list[ListedCommand]:
    """Those that have --json."""
    return [one for one in every if any(parameter.name == "as_json" for parameter in one.command.params)]


def test_every_example_can_be_asked(every: list[ListedCommand]) -> None:
    for one in every:
        context = one.command.make_context(one.path[-1], shlex.split(one.entry.example))
        assert context.params, _name(one)
        required = [parameter.name for parameter in one.command.params if parameter.required]
        assert not required or one.entry.example, f"{_name(one)} wants {required}: give it an example"


def test_the_list_says_what_the_commands_own_help_says(every: list[ListedCommand]) -> None:
    for one in every:
        first, _, _ = (one.command.help or "").partition("\n\n")
        assert " ".join(first.split()) == one.entry.says, _name(one)
        assert one.command.name == one.path[-1]


def test_the_page_is_made_of_the_table() -> None:
    page = Path("docs/cli.md").read_text(encoding="utf-8")
    assert page == markdown(), "make it anew: python -m services.operator.cli.page > docs/cli.md"


def test_every_command_stands_under_a_heading() -> None:
    assert all(entry.panel for entry in COMMANDS.values())


@pytest.fixture
def nothing_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """No cell's file, no stack, and a folder of its own."""
    monkeypatch.setenv("CROSSPIH_CELL", str(tmp_path / "no-cell.yaml"))
    monkeypatch.setenv("CROSSPIH_ENDPOINT", "tcp/127.0.0.1:1")
    monkeypatch.setenv("CROSSPIH_RUN_DIR", str(tmp_path / "run"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _error_of(text: str) -> dict[str, str]:
    error = json.loads(text)["error"]
    assert set(error) == {"code", "text", "field", "mend"} and error["code"] and error["text"]
    assert "Traceback" not in error["text"]
    return dict(error)


def test_what_cannot_be_asked_so_is_an_object_too(with_json: list[ListedCommand]) -> None:
    assert len(with_json) > 40
    for one in with_json:
        said = CliRunner().invoke(app, [*one.path[1:], "--json", "--no-such-option"])
        assert said.exit_code == 2, _name(one)
        assert _error_of(said.stdout)["field"] == "--no-such-option", _name(one)


def _fails_at_once(one: ListedCommand) -> bool:
    if _name(one).startswith("bench ") or _name(one) == "cell drivers":
        return _name(one) in FAIL_AT_ONCE
    return _name(one) not in SAY_IT_THEMSELVES


def test_a_failure_is_one_line_and_an_object(with_json: list[ListedCommand], nothing_there: Path) -> None:
    for one in filter(_fails_at_once, with_json):
        words = shlex.split(one.entry.example.partition("--cell")[0])
        if any(parameter.name == "cell" for parameter in one.command.params):
            words += ["--cell", str(nothing_there / "no-cell.yaml")]
        said = CliRunner().invoke(app, [*one.path[1:], *words, "--json"])
        assert said.exit_code == (2 if _name(one) == "locate" else 1), (_name(one), said.output)
        error = _error_of(said.stdout.splitlines()[-1])
        assert error["text"].splitlines()[0][:60] in said.stderr, (_name(one), said.stderr)
        assert error["code"] != "defect", (_name(one), error)


@pytest.fixture
def defect(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A command that falls over something that nobody foresaw."""

    def fall(*_: object) -> None:
        raise KeyError("wrench")

    monkeypatch.setattr("services.operator.contract.command.rows", fall)
    yield


def test_a_defect_is_a_line_and_its_traceback_there_for_who_mends_it(
    defect: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(TRACEBACK, raising=False)
    said = CliRunner().invoke(app, ["keys"])
    assert said.exit_code == 1 and said.stderr.startswith("KeyError: 'wrench'; this is a defect of crosspih")
    monkeypatch.setenv(TRACEBACK, "1")
    assert isinstance(CliRunner().invoke(app, ["keys"]).exception, KeyError)


def test_what_an_operating_system_refuses_is_named() -> None:
    failure = failure_of(PermissionError(13, "Permission denied", "/a/file"))
    assert (failure.code, failure.text, failure.field) == ("file", "/a/file: Permission denied", "/a/file")


def test_a_choice_that_is_none_is_told_the_nearest() -> None:
    assert with_nearest("'fuzed' is not one of 'fused', 'paper'.") == (
        "'fuzed' is not one of 'fused', 'paper'; did you mean fused?"
    )
    assert with_nearest("something else") == "something else"


def test_the_version_says_what_two_machines_have_to_have_alike() -> None:
    said = CliRunner().invoke(app, ["--version"])
    assert said.exit_code == 0
    assert [line.split()[0] for line in said.stdout.splitlines()] == ["crosspih", "messages", "Python", "Zenoh"]


def _completed(words: str) -> list[str]:
    """What bash is told when TAB is pressed behind these words."""
    position = len(shlex.split(words)) - (0 if words.endswith(" ") else 1)
    asked = {"_CROSSPIH_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(position)}
    return CliRunner().invoke(app, [], prog_name="crosspih", env=asked).stdout.split()


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("crosspih to", {"topic"}),
        ("crosspih topic h", {"hz"}),
        ("crosspih doctor --str", {"--strategy"}),
        ("crosspih doctor --strategy force", {"force_alone"}),
        ("crosspih topic hz ft/", {"ft/raw"}),
    ],
)
def test_a_shell_completes_commands_options_words_of_a_choice_and_topics(words: str, completed: set[str]) -> None:
    assert set(_completed(words)) == completed


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_script(shell: str, monkeypatch: pytest.MonkeyPatch) -> None:
    said = CliRunner().invoke(app, [], prog_name="crosspih", env={"_CROSSPIH_COMPLETE": f"source_{shell}"})
    assert "_CROSSPIH_COMPLETE=complete_" in said.stdout, said.output
