"""Payloads drawn from a message's own JSON schema: valid ones, absurd ones that still fit it, and broken ones."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from enum import Enum
from typing import Any

from crosspih_common.messages.base import MAX_PLACE_M

# numbers that are difficult for arithmetic, all valid in JSON
EXTREMES = (0.0, -0.0, 5e-324, 1e-30, -1e-9, 1.0, -1.0, 1e3, -1e6, 1e12, -1e30, 1e154, 1.7e308, -1.7e308)
WHOLE_EXTREMES = (0, -1, 1, 2**31, -(2**31), 2**53, 2**63 - 1, -(2**63), 2**64, 10**30, 10**400)
WORDS = ("", "a", "../../etc/passwd", "\x00", "é漢🦾", "%s%n", "*/**", "'; --", "\u202e", "x" * 3000)
# probability of an extreme value, chosen per payload
WILD = (0.0, 0.03, 0.3, 1.0)
# probability that an optional field is present
FILLED = (0.1, 0.5, 0.9)
DEPTH = 3000
MAX_ITEMS = 12
NEAR = 50.0  # newtons, radians, metres: hardly any value of a cell is larger


class Sort(str, Enum):
    """The kind of a payload."""

    FITTING = "fitting"  # fits the schema, with numbers as absurd as it allows
    MISFIT = "misfit"  # JSON, but a field is missing, unknown, of another type or out of range
    BROKEN = "broken"  # bytes flipped, cut, doubled; not JSON, not UTF-8, nested without end


class PayloadMaker:
    """Draws payloads for one JSON schema (as pydantic's `model_json_schema` gives it) from a seed."""

    def __init__(self, schema: dict[str, Any], seed: int | str) -> None:
        self._schema, self._definitions = schema, schema.get("$defs", {})
        self._rng = random.Random(seed)
        self._wild, self._filled = 0.0, 0.5
        self._position: list[float] | None = None
        self._quaternion: list[float] | None = None

    def payload(self, sort: Sort) -> bytes:
        """One payload."""
        self._wild, self._filled = self._rng.choice(WILD), self._rng.choice(FILLED)
        self._position = self._quaternion = None
        value = self._value(self._schema)
        if sort is Sort.FITTING:
            return json.dumps(value).encode()
        if sort is Sort.MISFIT:
            return json.dumps(self._misfit(value)).encode("utf-8", "surrogatepass")
        return self._broken(json.dumps(value).encode())

    # ------------------------------------------------------------------------------------------------------ fitting

    def _value(self, schema: dict[str, Any]) -> Any:
        if "$ref" in schema:
            return self._value(self._definitions[schema["$ref"].rsplit("/", 1)[1]])
        for several in ("anyOf", "oneOf"):
            if several in schema:
                return self._value(self._one_of(schema[several]))
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            return self._one_of(schema["enum"])
        makers: dict[str, Callable[[dict[str, Any]], Any]] = {
            "object": self._object,
            "array": self._array,
            "number": self._number,
            "integer": self._whole,
            "string": self._word,
            "boolean": lambda _: self._rng.random() < 0.5,
            "null": lambda _: None,
        }
        return makers[schema.get("type", "null")](schema)

    def _one_of(self, choices: Any) -> Any:
        return self._rng.choice(choices)

    def _object(self, schema: dict[str, Any]) -> dict[str, Any]:
        required = schema.get("required", ())
        value = {
            name: self._value(of)
            for name, of in schema.get("properties", {}).items()
            if name in required or self._rng.random() < self._filled
        }
        others = schema.get("additionalProperties")
        if isinstance(others, dict):
            value |= {self._word({}): self._value(others) for _ in range(self._rng.randrange(4))}
        return value

    def _array(self, schema: dict[str, Any]) -> list[Any]:
        least = schema.get("minItems", 0)
        most = min(schema.get("maxItems", least + MAX_ITEMS), least + MAX_ITEMS)
        # six or seven joints: the same number in every field
        count = least if most == least + 1 else least + int((most + 1 - least) * self._rng.random() ** 2)
        of = schema.get("items", {})
        meant = schema.get("format", "")
        if self._rng.random() < 0.95:
            if meant == "covariance":
                return [self._rng.uniform(1e-8, 1e-2) if at % 7 == 0 else 0.0 for at in range(count)]
            if meant == "standard_deviations":
                return [abs(self._value(of)) for _ in range(count)]
            if meant == "unit_quaternion":
                self._quaternion = self._near(self._quaternion, [self._rng.gauss(0.0, 1.0) for _ in range(count)])
                return [one / math.hypot(*self._quaternion) for one in self._quaternion]
            if count == 3 and of.get("maximum") == MAX_PLACE_M:
                self._position = self._near(self._position, [self._value(of) for _ in range(count)])
                return [min(max(one, -MAX_PLACE_M), MAX_PLACE_M) for one in self._position]
        return [self._value(of) for _ in range(count)]

    def _near(self, last: list[float] | None, other: list[float]) -> list[float]:
        """Values that a payload's poses share: most are near one place, so that such a request is not refused."""
        if last is None or self._rng.random() < 0.4:
            return other
        spread = 10.0 ** self._rng.uniform(-6.0, -0.5)
        return [one + self._rng.gauss(0.0, spread) for one in last]

    def _number(self, schema: dict[str, Any]) -> float:
        least = schema.get("minimum", schema.get("exclusiveMinimum"))
        most = schema.get("maximum", schema.get("exclusiveMaximum"))
        if self._rng.random() < self._wild:
            inside = [
                one for one in EXTREMES if (least is None or one > least) and (most is None or one < most)
            ] or [1e-9 if most is None else most]  # fmt: skip
            return float(self._one_of(inside))
        if (least is None or least < -NEAR) and (most is None or most > NEAR) and self._rng.random() < 0.95:
            # as large as values of a cell, not as any number can be
            return float(self._rng.choice((-1.0, 1.0)) * 10.0 ** self._rng.uniform(-6.0, math.log10(NEAR)))
        low, high = (-1.0 if least is None else least), (1.0 if most is None else most)
        return float(low + (max(high, low) - low or 1.0) * self._rng.uniform(1e-6, 1.0))

    def _whole(self, schema: dict[str, Any]) -> int:
        least, most = schema.get("minimum", schema.get("exclusiveMinimum", -1)), schema.get("maximum")
        if self._rng.random() < self._wild:
            inside = [one for one in WHOLE_EXTREMES if one > least and (most is None or one <= most)]
            return int(self._one_of(inside or [least + 1]))
        return int(least) + 1 + self._rng.randrange(5 if most is None else max(int(most) - int(least), 1))

    def _word(self, schema: dict[str, Any]) -> str:
        word = str(self._one_of(WORDS)) if self._rng.random() < max(self._wild, 0.1) else "word"
        word = word.ljust(schema.get("minLength", 0), "w")
        return word[: schema.get("maxLength", len(word))]

    # ------------------------------------------------------------------------------------------------ not fitting

    def _misfit(self, value: Any) -> Any:
        """A value with one part of it replaced, left out or added."""
        strange = self._one_of(
            (None, True, -1, 10**4000, "", "\ud800", [], [[]], {}, {"a": {}}, float("nan"), float("inf"), "NaN", 1e308)
        )
        place, holder = value, None
        path: Any = None
        while isinstance(place, dict | list) and place and self._rng.random() < 0.8:
            path = self._one_of(list(place)) if isinstance(place, dict) else self._rng.randrange(len(place))
            holder, place = place, place[path]
        if holder is None:
            return strange if self._rng.random() < 0.1 else {**value, f"not a field {len(value)}": strange}
        what = self._rng.randrange(3)
        if what == 0 or isinstance(holder, list):
            holder[path] = strange
        elif what == 1:
            del holder[path]
        else:
            holder["not_a_field"] = strange
        return value

    def _broken(self, payload: bytes) -> bytes:
        whole = bytearray(payload)
        what = self._rng.randrange(8)
        at = self._rng.randrange(max(len(whole), 1))
        if what == 0:
            return bytes(whole[:at])
        if what == 1:
            for _ in range(self._rng.randrange(1, 9)):
                if whole:
                    whole[self._rng.randrange(len(whole))] ^= 1 << self._rng.randrange(8)
            return bytes(whole)
        if what == 2:
            return self._rng.randbytes(self._rng.randrange(300))
        if what == 3:
            return bytes(whole[:at] + whole)
        if what == 4:
            return b"[" * DEPTH if at % 2 else b'{"a":' * DEPTH
        if what == 5:
            return bytes(whole).replace(b":", b":" + b"9" * DEPTH, 1)
        if what == 6:
            return b"\xff\xfe" + payload
        return b'{"knots":' + b"[" * DEPTH + b"]" * DEPTH + b"}"
