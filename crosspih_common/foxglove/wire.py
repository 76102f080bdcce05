"""A hand-written encoder of protobuf's wire format, for messages that are sent many times a second.

Making the library's objects takes ten times as long. tests/common/test_foxglove.py checks each message with the
library. Format: https://protobuf.dev/programming-guides/encoding
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from google.protobuf.timestamp_pb2 import Timestamp

_VECTOR3 = struct.Struct("<cdcdcd")
_QUATERNION = struct.Struct("<cdcdcdcd")
_X, _Y, _Z, _W = b"\x09", b"\x11", b"\x19", b"\x21"  # doubles 1 to 4


def field(number: int, data: bytes) -> bytes:
    """A field with a number below 16 that holds bytes: a text or a message."""
    return bytes((number << 3 | 2,)) + _length(len(data)) + data


def text(number: int, value: str) -> bytes:
    """A field with a text."""
    return field(number, value.encode())


def _length(size: int) -> bytes:
    if size < 0x80:
        return bytes((size,))
    groups = []
    while size >= 0x80:
        groups.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes((*groups, size))


def stamp_field(number: int, stamp_ns: int) -> bytes:
    """A field with a Timestamp."""
    seconds, nanos = divmod(max(stamp_ns, 0), 1_000_000_000)
    return field(number, Timestamp(seconds=seconds, nanos=nanos).SerializeToString())


def vector3(values: Sequence[float]) -> bytes:
    """The body of foxglove.Vector3."""
    x, y, z = values
    return _VECTOR3.pack(_X, x, _Y, y, _Z, z)


def quaternion(values: Sequence[float]) -> bytes:
    """The body of foxglove.Quaternion, (x, y, z, w)."""
    x, y, z, w = values
    return _QUATERNION.pack(_X, x, _Y, y, _Z, z, _W, w)
