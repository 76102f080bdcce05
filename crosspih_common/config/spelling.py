"""Suggestions for misspelt words: names of a section's fields, values of a choice. Pure."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from typing import Any, get_args

from pydantic import BaseModel

LIKE = 0.6  # of difflib's ratio: "nam" for "name", "frictoin" for "friction"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`did you mean name?`, with the nearest of the known words; empty where none is near."""
    by_lower = {one.lower(): one for one in known}
    near = difflib.get_close_matches(word.lower(), list(by_lower), n=1, cutoff=LIKE)
    return f"did you mean {by_lower[near[0]]}?" if near else ""


def fields_beside(model: type[BaseModel], where: Sequence[int | str]) -> list[str]:
    """The valid fields at the place where pydantic found an unknown one; `where` is the `loc` of its error."""
    models: list[type[BaseModel]] = [model]
    for part in where[:-1]:
        fields = [one.model_fields[part] for one in models if isinstance(part, str) and part in one.model_fields]
        if fields:
            models = [found for field in fields for found in _models_in(field.annotation)]
        # else it is the index of an element, the key of a mapping, or the member of a union
    return [name for one in models for name in one.model_fields]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """All section models that a field of this type may hold."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for one in get_args(annotation) for found in _models_in(one)]


def words_of(expected: str) -> list[str]:
    """The values of a choice, parsed from pydantic's text: `'realtime' or 'max'`."""
    return re.findall(r"'([^']*)'", expected)
