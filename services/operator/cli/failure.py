"""How a command fails: in one line, with `--json` as an object on standard output too, and never by a traceback."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import typer

from crosspih_common.errors import CrosspihError

if TYPE_CHECKING:
    from rich.console import Console

TRACEBACK = "CROSSPIH_TRACEBACK"  # for who mends crosspih itself: an error that nobody foresaw with its traceback
USAGE = "usage"
DEFECT = "defect"


@dataclass(frozen=True, slots=True)
class CommandFailure:
    """What `--json` prints of an error: `code` for programs, `text` for people; what it is about and what would mend
    it, empty where nobody said."""

    code: str
    text: str
    field: str = ""
    mend: str = ""

    def as_json(self) -> str:
        """One line."""
        return json.dumps({"error": asdict(self)}, ensure_ascii=False) + "\n"


class Failed(typer.Exit):
    """Ends a command whose error was told in words already."""

    def __init__(self, failure: CommandFailure, status: int = 1) -> None:
        super().__init__(status)
        self.failure = failure


def failure_of(error: Exception) -> CommandFailure:
    """What there is to say of an error, foreseen or not."""
    if isinstance(error, CrosspihError):
        return CommandFailure(_code_of(error), str(error), error.field, error.mend)
    if isinstance(error, OSError):
        about = str(error.filename or "")
        return CommandFailure("file", f"{about + ': ' if about else ''}{error.strerror or error}", about)
    if isinstance(error, ModuleNotFoundError):
        from crosspih_common.modules import not_installed

        return CommandFailure("not_installed", f"crosspih: {not_installed(error)}", error.name or "")
    said = " ".join(str(error).split()) or "no words"
    mend = f"this is a defect of crosspih; {TRACEBACK}=1 before the command shows where"
    return CommandFailure(DEFECT, f"{type(error).__name__}: {said}; {mend}", mend=mend)


def _code_of(error: CrosspihError) -> str:
    """Its own, or for one that has none what its class is called: not_up of NotUpError."""
    if error.code != CrosspihError.code:
        return error.code
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(error).__name__.removesuffix("Error")).lower()


def is_shown_whole(error: Exception) -> bool:
    """Whether its traceback is wanted: an error that nobody foresaw, where CROSSPIH_TRACEBACK says so."""
    foreseen = isinstance(error, (CrosspihError, ModuleNotFoundError, OSError))
    return bool(os.environ.get(TRACEBACK)) and not foreseen


def say(failure: CommandFailure) -> None:
    """In red on standard error."""
    from rich.console import Console

    Console(stderr=True).print(failure.text, style="red", markup=False, highlight=False, soft_wrap=True)


@contextmanager
def errors_shown(console: Console) -> Iterator[None]:
    """Errors of crosspih as one red line and exit status 1; Ctrl-C as 130."""
    try:
        yield
    except CrosspihError as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise Failed(failure_of(error)) from None
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def usage_failure(error: typer.BadParameter) -> CommandFailure:
    """Of a command line that cannot be."""
    hint, parameter = getattr(error, "param_hint", None), getattr(error, "param", None)
    names = getattr(parameter, "opts", None) or [getattr(error, "option_name", "")]
    about = hint if isinstance(hint, str) else max(names, key=len)
    shown = getattr(error, "ctx", None)
    mend = f"{shown.command_path} --help" if shown is not None else ""
    return CommandFailure(USAGE, error.format_message(), about.strip("'"), mend)


def with_nearest(message: str) -> str:
    """What Click says of a word that is none of a choice, with the nearest one."""
    message = message.removeprefix("Value error, ")
    found = re.match(r"'(?P<word>[^']*)' is not one of (?P<rest>.*)", message, re.DOTALL)
    if found is None:
        return message
    from crosspih_common.config.spelling import did_you_mean, words_of

    meant = did_you_mean(found["word"], words_of(found["rest"]))
    return f"{message.rstrip('.')}; {meant}" if meant else message


def print_json(failure: CommandFailure) -> None:
    """The object on standard output, where a program looks for it."""
    sys.stdout.write(failure.as_json())
    sys.stdout.flush()
