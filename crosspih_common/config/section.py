"""The root of every section of a cell's file."""

from __future__ import annotations

from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator


class Section(BaseModel):
    """Frozen; an unknown key is an error, so that a misspelt setting cannot be silently ignored."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_switch_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """`yes` in YAML is True, which a number takes as 1."""
        if isinstance(value, bool) and info.field_name is not None:
            kinds = _kinds(cls.model_fields[info.field_name].annotation)
            if bool not in kinds and kinds & {int, float}:
                raise ValueError(f"want a number, got a switch ({str(value).lower()})")
        return value


def _kinds(annotation: Any) -> set[Any]:
    return {annotation}.union(*(_kinds(one) for one in get_args(annotation)))
