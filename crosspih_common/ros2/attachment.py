"""The attachment of rmw_zenoh to each sample, request and reply: number, time and sender.

`rmw_zenoh_cpp/src/detail/attachment_helpers.cpp` since 0.1.2, 0.2.4 and 0.6.0: int64 number, int64 ns since 1970, both
little-endian, one byte 16, and the 16 bytes of the sender's gid. Releases before those wrote the fields' names as well
and are not understood here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

GID_BYTES = 16
_HEAD = struct.Struct("<qqB")


@dataclass(frozen=True, slots=True)
class SampleAttachment:
    """`sequence` counts from 1 for each sender; `stamp_ns` is the sender's wall clock; `gid` has 16 bytes."""

    sequence: int
    stamp_ns: int
    gid: bytes

    def __post_init__(self) -> None:
        if len(self.gid) != GID_BYTES:
            raise ValueError(f"gid has {len(self.gid)} bytes, want {GID_BYTES}")

    def to_bytes(self) -> bytes:
        """The attachment as 33 bytes."""
        return _HEAD.pack(self.sequence, self.stamp_ns, GID_BYTES) + self.gid

    @classmethod
    def of(cls, raw: bytes) -> SampleAttachment:
        """From the 33 bytes. Raises ValueError for other bytes."""
        if len(raw) != _HEAD.size + GID_BYTES or raw[_HEAD.size - 1] != GID_BYTES:
            raise ValueError(
                f"{len(raw)} bytes are no attachment of rmw_zenoh, want {_HEAD.size + GID_BYTES}: releases of before "
                "0.1.2 (humble), 0.2.4 (jazzy) and 0.6.0 (kilted) wrote another form; use a later one"
            )
        sequence, stamp_ns, _ = _HEAD.unpack_from(raw)
        return cls(sequence, stamp_ns, raw[_HEAD.size :])
