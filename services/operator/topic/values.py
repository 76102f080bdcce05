"""A message formatted for people: plain values, one field of it, as YAML or as one line of JSON. Pure."""

from __future__ import annotations

import difflib
import json
from typing import Any

import yaml

from crosspih_common.errors import ConfigError
from crosspih_common.keys import Payload
from crosspih_common.messages import Image

MAX_IN_A_ROW = 24  # longest list of numbers that is shown whole; --full prints them all


def plain_values(payload: Payload) -> dict[str, Any]:
    """The fields of a message as JSON types; for a picture all but its pixels."""
    if isinstance(payload, Image):
        height, width = payload.pixels.shape[:2]
        return {
            "stamp_ns": payload.stamp_ns, "seq": payload.seq, "frame": payload.frame, "encoding": payload.encoding,
            "width": width, "height": height, "mean": round(float(payload.pixels.mean()), 2),
        }  # fmt: skip
    return payload.model_dump(mode="json")


def field_of(values: Any, path: str) -> Any:
    """The value at `pose.position_m.0`: names of fields and indices of lists, separated by dots.

    Raises ConfigError naming the part that does not exist, and those that do.
    """
    found, been = values, "the message"
    for part in path.split("."):
        if isinstance(found, dict) and part in found:
            found = found[part]
        elif isinstance(found, list) and part.lstrip("-").isdigit() and -len(found) <= int(part) < len(found):
            found = found[int(part)]
        else:
            raise ConfigError(f"--field {path}: {_not_there(found, part, been)}")
        been = part
    return found


def _not_there(found: Any, part: str, been: str) -> str:
    if isinstance(found, dict):
        near = difflib.get_close_matches(part, list(found), n=1)
        meant = f"did you mean {near[0]}? " if near else ""
        return f"{been} has no {part}; {meant}it has {', '.join(found)}"
    if isinstance(found, list):
        return f"{been} is a list of {len(found)}; write a number from 0 to {len(found) - 1}, not {part}"
    return f"{been} is a single value and has no {part}; leave that out"


def shortened(values: Any) -> Any:
    """The same value; long lists are cut, with the number of the remaining values."""
    if isinstance(values, dict):
        return {name: shortened(value) for name, value in values.items()}
    if isinstance(values, list):
        if len(values) > MAX_IN_A_ROW:
            more = len(values) - MAX_IN_A_ROW
            return [*(shortened(value) for value in values[:MAX_IN_A_ROW]), f"and {more} more: --full shows them"]
        return [shortened(value) for value in values]
    return values


def as_yaml(values: Any) -> str:
    """Ready to print, with a line break at its end; lists of plain values stand in one line."""
    text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True)
    return text.removesuffix("...\n")


def as_json_line(values: Any) -> str:
    """One line, with a line break at its end."""
    return json.dumps(values, ensure_ascii=False) + "\n"
