"""The commands of the docs: found in their ```sh blocks, and parsed by the real command line without running them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
# pages that commands write; results.md shows what was typed, some of it cut
MADE = {"results.md", "fuzz.md", "wire.md"}
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)
ASSIGNMENT = re.compile(r"[A-Z_]+=.*")


@dataclass(frozen=True, slots=True)
class Shown:
    """A command as a page shows it: its words, without comment, and the comment."""

    page: str
    words: tuple[str, ...]
    comment: str

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)}"


def shown_commands() -> Iterator[Shown]:
    """Every command of every ```sh block; `a && b` are two, and what is set before a command is left out."""
    for page in PAGES:
        if page.name in MADE:
            continue
        name = page.relative_to(ROOT).as_posix()
        for block in BLOCK.findall(page.read_text(encoding="utf-8")):
            for line in block.replace("\\\n", " ").splitlines():
                yield from _of_line(name, line)


def _of_line(page: str, line: str) -> Iterator[Shown]:
    lexer = shlex.shlex(line, posix=True, punctuation_chars="&;|<>")
    lexer.whitespace_split = True
    lexer.commenters = "#"
    comment = line.partition(" # ")[2]
    words: list[str] = []
    for word in [*lexer, "&&"]:
        if not set(word) <= set("&;|<>") or not word:
            words.append(word)
            continue
        if ">" in word or "<" in word:
            words.append("\0")  # what follows is a file
            continue
        yield from _of_words(page, words, comment)
        words = []


def _of_words(page: str, words: list[str], comment: str) -> Iterator[Shown]:
    if "\0" in words:
        words = words[: words.index("\0")]
    if words[:1] == ["export"]:
        return
    while words and ASSIGNMENT.fullmatch(words[0]):
        words = words[1:]
    if words[:1] == ["nice"]:
        words = words[3:] if words[1] == "-n" else words[2:]
    if words:
        yield Shown(page, tuple(words), comment)


class NoSuchCommand(Exception):
    """A word that is no command of its group."""


def command_line() -> TyperGroup:
    """The `crosspih` command; what it is made of is imported when it is asked for."""
    from services.operator.__main__ import app

    command = get_command(app)
    assert isinstance(command, TyperGroup)
    return command


def parsed(root: TyperGroup, words: tuple[str, ...]) -> tuple[str, ...]:
    """The names of the command that these words call. Its options and values are parsed, nothing is run.

    Files that are named need not be there. Raises NoSuchCommand, or what the command line itself raises.
    """
    command: TyperCommand | TyperGroup = root
    context = typer.Context(root, info_name="crosspih")
    rest, names = list(words), list[str]()
    while isinstance(command, TyperGroup):
        if not rest or rest[0].startswith("-"):
            return tuple(names)
        found = command.get_command(context, rest[0])
        if not isinstance(found, TyperCommand | TyperGroup):
            raise NoSuchCommand(" ".join([*names, rest[0]]))
        names.append(rest.pop(0))
        command, context = found, typer.Context(found, info_name=names[-1], parent=context)
    if "--help" not in rest:
        with _files_need_not_be_there(command):
            command.parse_args(context, rest)
    return tuple(names)


@contextmanager
def _files_need_not_be_there(command: TyperCommand) -> Iterator[None]:
    told = [getattr(parameter, "type_descriptor").parameter_info for parameter in command.params]  # noqa: B009  no type
    asked = [(info, info.exists) for info in told if getattr(info, "exists", False)]
    for info, _ in asked:
        info.exists = False
    try:
        yield
    finally:
        for info, exists in asked:
            info.exists = exists
