"""The options of the two benches that end processes in the middle of an assembly."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, TypeVar

import typer

from crosspih_common.errors import ConfigError
from services.operator.bench.reliability.kills.plan import PHASES

ChoiceT = TypeVar("ChoiceT", bound=str)  # enumerations of strings, too

Phases = Annotated[list[str] | None, typer.Option(help=f"{', '.join(one.value for one in PHASES)}; all when left out.")]
Speed = Annotated[str, typer.Option(help="realtime, or max: the cell's clock runs only while a command does.")]
Seed = Annotated[int, typer.Option(min=0, help="Draws the hole.")]


def chosen(option: str, asked: Iterable[str] | None, known: Iterable[ChoiceT]) -> tuple[ChoiceT, ...]:
    """The known names that were asked for, in the known order; all where none was. Raises ConfigError."""
    every, wanted = tuple(known), set(asked or ())
    if unknown := sorted(wanted - set(every)):
        raise ConfigError(f"{option} {', '.join(unknown)}: want one of {', '.join(every)}")
    return tuple(one for one in every if not wanted or one in wanted)
