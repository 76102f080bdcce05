"""The argument of a topic's name, which a shell can complete."""

from __future__ import annotations

from typing import Annotated

import typer

from crosspih_common.keys import topics
from services.operator.topic.naming import shown


def names_beginning(incomplete: str) -> list[tuple[str, str]]:
    """(name, what it is) of every topic whose name begins so, for a shell."""
    named = ((shown(topic), topic.doc) for topic in topics())
    return [(path, said) for path, said in named if path.startswith(incomplete)]


TopicName = Annotated[
    str,
    typer.Argument(
        metavar="TOPIC", help="Its key as `crosspih topic list` shows it, such as ft/raw or service/planning/status.",
        autocompletion=names_beginning,
    ),
]  # fmt: skip
