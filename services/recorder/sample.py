"""One sample as it was sent, and its stamp read without decoding it."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from google.protobuf.message import DecodeError
from google.protobuf.timestamp_pb2 import Timestamp
from pydantic_core import from_json

from crosspih_common.errors import ContractError
from crosspih_common.keys import Topic
from crosspih_common.messages import Image

# pydantic writes the root's fields first, so that the stamp opens every message
STAMP_FIRST = b'{"stamp_ns":'
LONGEST_STAMP = len(STAMP_FIRST) + 19 + 1  # up to the comma after it
_STAMP_FIRST = re.compile(rb'\s*\{\s*"stamp_ns"\s*:\s*(-?\d{1,19})\s*[,}]')


class Sample(NamedTuple):
    """A payload with the fields that MCAP needs: `stamp_ns` is the cell's clock, `wall_ns` this
    machine's on arrival.
    """

    key: str
    topic: Topic[Any]
    payload: bytes
    seq: int
    stamp_ns: int
    wall_ns: int


# A sample as it waits for the writer: a named tuple would take three times as long to make.
Waiting = tuple[str, Topic[Any], bytes, int, int, int]


def stamp_of(topic: Topic[Any], payload: bytes) -> int:
    """The cell time of a payload, ns. Raises ContractError when it has none."""
    return _image_stamp(payload) if topic.type is Image else _json_stamp(payload)


def _json_stamp(payload: bytes) -> int:
    match = _STAMP_FIRST.match(payload)
    if match is not None:
        return int(match.group(1))
    try:
        stamp_ns = from_json(payload)["stamp_ns"]  # refuses endless nesting, on which json fails
    except (ValueError, TypeError, KeyError):
        stamp_ns = None
    if not isinstance(stamp_ns, int) or not -1 <= stamp_ns < 1 << 63:
        raise ContractError("the payload is no JSON object with an integer `stamp_ns`")
    return stamp_ns


def _image_stamp(payload: bytes) -> int:
    # field 1 (0x0a) of RawImage is its timestamp and is written first, in fewer than 128 bytes
    if len(payload) < 2 or payload[0] != 0x0A or payload[1] >= 0x80:
        raise ContractError("the payload is no foxglove.RawImage with a timestamp")
    try:
        return int(Timestamp.FromString(payload[2 : 2 + payload[1]]).ToNanoseconds())
    except DecodeError as error:
        raise ContractError(f"the payload's timestamp does not decode: {error}") from None
