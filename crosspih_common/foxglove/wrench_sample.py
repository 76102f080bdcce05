"""One sample of a wrench as a protobuf message: Foxglove has none of its own, and its viewers plot any numbers.

    message crosspih.WrenchSample {
      google.protobuf.Timestamp timestamp = 1;
      string frame_id = 2;
      foxglove.Vector3 force = 3;     // N, on the peg
      foxglove.Vector3 moment = 4;    // Nm, about the frame's origin
      double force_norm = 5;          // N
      double moment_norm = 6;         // Nm
    }

Written by hand, field by field: a thousand come each second.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from math import sqrt

from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

from crosspih_common.foxglove.wire import stamp_field, text

WRENCH_SAMPLE = "crosspih.WrenchSample"
_FIELDS = (
    ("timestamp", ".google.protobuf.Timestamp"),
    ("frame_id", "string"),
    ("force", ".foxglove.Vector3"),
    ("moment", ".foxglove.Vector3"),
    ("force_norm", "double"),
    ("moment_norm", "double"),
)
# tag and length of each Vector3, tag of each double, as the wire format has them
_NUMBERS = struct.Struct("<2scdcdcd2scdcdcdcdcd")
_FORCE, _MOMENT, _X, _Y, _Z = b"\x1a\x1b", b"\x22\x1b", b"\x09", b"\x11", b"\x19"
_FORCE_NORM, _MOMENT_NORM = b"\x29", b"\x31"


def wrench_sample_file() -> FileDescriptorSet:
    """The schema with what it imports."""
    files = FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    Vector3.DESCRIPTOR.file.CopyToProto(files.file.add())
    file = FileDescriptorProto(name="crosspih_wrench_sample.proto", package="crosspih", syntax="proto3")
    file.dependency.extend(known.name for known in files.file)
    message = file.message_type.add(name="WrenchSample")
    kinds = {"string": FieldDescriptorProto.TYPE_STRING, "double": FieldDescriptorProto.TYPE_DOUBLE}
    for number, (name, kind) in enumerate(_FIELDS, start=1):
        field = message.field.add(name=name, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL)
        field.type = kinds.get(kind, FieldDescriptorProto.TYPE_MESSAGE)
        if kind not in kinds:
            field.type_name = kind
    files.file.append(file)
    return files


def wrench_encoder(frame: str) -> Callable[[int, Sequence[float]], bytes]:
    """An encoder of samples in one frame: (stamp, ns; wrench (6,), N and Nm) to the message's bytes."""
    named = text(2, frame)
    pack = _NUMBERS.pack

    def encode(stamp_ns: int, wrench: Sequence[float]) -> bytes:
        fx, fy, fz, mx, my, mz = wrench
        numbers = pack(
            _FORCE, _X, fx, _Y, fy, _Z, fz, _MOMENT, _X, mx, _Y, my, _Z, mz,
            _FORCE_NORM, sqrt(fx * fx + fy * fy + fz * fz), _MOMENT_NORM, sqrt(mx * mx + my * my + mz * mz),
        )  # fmt: skip
        return stamp_field(1, stamp_ns) + named + numbers

    return encode
