"""How a command reports an error: in one line, with `--json` also as an object on standard output, never by a
traceback.
"""

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

TRACEBACK = "CROSSPIH_TRACEBACK"  # for developers of crosspih: show an unforeseen error with its traceback
USAGE = "usage"
DEFECT = "defect"


@dataclass(frozen=True, slots=True)
class CommandFailure:
    """What `--json` prints of an error: `code` for programs, `text` for people; the subject and the remedy, empty where
    the error names none.
    """

    code: str
    text: str
    field: str = ""
    mend: str = ""

    def as_json(self) -> str:
        """One line."""
        return json.dumps({"error": asdict(self)}, ensure_ascii=False) + "\n"


class Failed(typer.Exit):
    """Ends a command whose error has already been printed."""

    def __init__(self, failure: CommandFailure, status: int = 1) -> None:
        super().__init__(status)
        self.failure = failure


def failure_of(error: Exception) -> CommandFailure:
    """The report of an error, foreseen or not."""
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
    """The error's own code; for an error without one, its class name in snake case: not_up of NotUpError."""
    if error.code != CrosspihError.code:
        return error.code
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(error).__name__.removesuffix("Error")).lower()


def is_shown_whole(error: Exception) -> bool:
    """Whether to show its traceback: for an unforeseen error, if CROSSPIH_TRACEBACK is set."""
    foreseen = isinstance(error, (CrosspihError, ModuleNotFoundError, OSError))
    return bool(os.environ.get(TRACEBACK)) and not foreseen


def say(failure: CommandFailure) -> None:
    """Print it in red on standard error."""
    from rich.console import Console

    Console(stderr=True).print(failure.text, style="red", markup=False, highlight=False, soft_wrap=True)


@contextmanager
def errors_shown(console: Console) -> Iterator[None]:
    """Print errors of crosspih as one red line with exit status 1; Ctrl-C gives 130."""
    try:
        yield
    except CrosspihError as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise Failed(failure_of(error)) from None
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def usage_failure(error: typer.BadParameter) -> CommandFailure:
    """The report of an invalid command line."""
    hint, parameter = getattr(error, "param_hint", None), getattr(error, "param", None)
    names = getattr(parameter, "opts", None) or [getattr(error, "option_name", "")]
    about = hint if isinstance(hint, str) else max(names, key=len)
    shown = getattr(error, "ctx", None)
    mend = f"{shown.command_path} --help" if shown is not None else ""
    return CommandFailure(USAGE, error.format_message(), about.strip("'"), mend)


def with_nearest(message: str) -> str:
    """Click's message about an unknown word, with the nearest valid one."""
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
