"""`crosspih cell init`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from rich.console import Console

from crosspih_common.config import cell_of_text
from crosspih_common.errors import ConfigError
from crosspih_common.plain_yaml import text_of_file, yaml_of
from services.operator.bench.options import errors_shown
from services.operator.cell.drivers import installed_drivers
from services.operator.cell.init.answers import InvalidAnswer, text_of
from services.operator.cell.init.questions import Answers, Question, questions
from services.operator.cell.init.writing import cell_text


def given_answers(file: Path | None, single: list[str]) -> dict[str, str]:
    """The answers of a file and of options, as text; an option goes before the file. Raises ConfigError."""
    given: dict[str, str] = {}
    if file is not None:
        try:
            content = yaml_of(text_of_file(file)) or {}
        except (OSError, yaml.YAMLError) as error:
            raise ConfigError(f"--answers {file}: cannot be read: {error}") from None
        if not isinstance(content, dict):
            raise ConfigError(f"--answers {file}: wants a mapping: name: bench3")
        given.update({str(key): text_of(value) for key, value in content.items()})
    for one in single:
        key, separator, value = one.partition("=")
        if not separator:
            raise ConfigError(f"--answer {one}: wants NAME=VALUE")
        given[key.strip()] = value.strip()
    return given


def asked(each: list[Question], given: dict[str, str], ask: bool, console: Console) -> Answers:
    """Every answer: the given one, else the one that is typed, else the default.

    Raises ConfigError for a given answer that is not valid, for one that no question wants, and for one that is missing
    when nothing may be asked.
    """
    unknown = sorted(given.keys() - {question.key for question in each})
    if unknown:
        names = ", ".join(question.key for question in each)
        raise ConfigError(f"{', '.join(unknown)}: no question has that name; want {names}")
    answers: Answers = {}
    for question in each:
        if not question.asked(answers):
            continue
        if question.key in given:
            try:
                answers[question.key] = question.read(given[question.key], answers)
            except InvalidAnswer as refused:
                raise ConfigError(f"{question.key}: {given[question.key]!r}: {refused}") from None
            continue
        default = question.default(answers)
        answers[question.key] = _typed(question, answers, default, console) if ask else _default(
            question, answers, default
        )  # fmt: skip
    return answers


def _typed(question: Question, answers: Answers, default: str | None, console: Console) -> Any:
    while True:
        said: str = typer.prompt(question.text, default=default, type=str)
        try:
            return question.read(said.strip(), answers)
        except InvalidAnswer as refused:
            console.print(f"  {refused}", style="red", markup=False, highlight=False, soft_wrap=True)


def _default(question: Question, answers: Answers, default: str | None) -> Any:
    if default is None:
        raise ConfigError(f"{question.key}: has no default; give it with --answer {question.key}=VALUE")
    try:
        return question.read(default, answers)
    except InvalidAnswer as refused:
        raise ConfigError(f"{question.key}: the default does not do here: {refused}") from None


def init(
    file: Annotated[Path, typer.Argument(help="The cell's file to be made.")] = Path("cell.yaml"),
    answers: Annotated[
        Path | None, typer.Option(help="Answers from a YAML file, by the names of the questions.")
    ] = None,
    answer: Annotated[list[str] | None, typer.Option(help="One answer, NAME=VALUE; may be repeated.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: the defaults where no answer is given.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
) -> None:
    """Make a cell's file by answering questions; each answer is checked at once."""
    console = Console()
    with errors_shown(console):
        if file.exists() and not force:
            raise ConfigError(f"{file} is there already; another name, or --force to write over it")
        if not file.resolve().parent.is_dir():
            raise ConfigError(f"{file}: its folder is not there; make it first")
        given = given_answers(answers, answer or [])
        drivers = installed_drivers()
        found = asked(questions(drivers), given, not yes, console)
        text = cell_text(found, file, {str(one["name"]): str(one["address"]) for one in drivers})
        cell_of_text(file, text)
        try:
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{file}: cannot be written ({error.strerror})") from None
        console.print(f"{file} is written; next: crosspih doctor --cell {file}", highlight=False)
