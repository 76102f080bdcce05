"""Compares two messages that should be equal, a recorded and a new one, field by field."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from crosspih_common.messages import Message

# fields that depend on the moment, not on the answer: when it was given, its duration, the number of earlier pictures
OF_THE_MOMENT = frozenset({"stamp_ns", "seq", "compute_s", "capture_wall_s", "capture_id"})
NONE: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """A field that differs; for a list, the entry that differs most, with its index. `by` is for numbers."""

    field: str
    then: str
    now: str
    by: float | None

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return asdict(self)


def differences(then: Message, now: Message, but: frozenset[str] = NONE) -> list[FieldDifference]:
    """The fields of two messages that are not equal bit for bit; those of the moment and in `but` are left out."""
    return list(_walk(then.model_dump(mode="json"), now.model_dump(mode="json"), "", OF_THE_MOMENT | but))


def _walk(then: Any, now: Any, where: str, but: frozenset[str] = NONE) -> Iterator[FieldDifference]:
    if isinstance(then, dict) and isinstance(now, dict):
        for name in dict.fromkeys([*then, *now]):
            if where or name not in but:
                yield from _walk(then.get(name), now.get(name), f"{where}.{name}" if where else name)
    elif _numbers(then) and _numbers(now) and len(then) == len(now):
        off = [abs(a - b) for a, b in zip(then, now, strict=True)]
        most = max(range(len(off)), key=off.__getitem__, default=0)
        if then != now:
            yield FieldDifference(f"{where}[{most}]", f"{then[most]:.9g}", f"{now[most]:.9g}", off[most])
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for index, (one, other) in enumerate(zip(then, now, strict=True)):
            yield from _walk(one, other, f"{where}[{index}]")
    elif then != now:
        if _number(then) and _number(now):
            yield FieldDifference(where, f"{then:.9g}", f"{now:.9g}", abs(then - now))
        else:
            yield FieldDifference(where, _told(then), _told(now), None)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _numbers(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(_number(entry) for entry in value)


def _told(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
