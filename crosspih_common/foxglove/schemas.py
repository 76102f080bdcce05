"""The topics that are made for viewers: their names, schemas and meaning.

All of them are below `/foxglove/`, so that a reader of a recording can distinguish them from the topics of the bus.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module

from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from crosspih_common.foxglove.wrench_sample import WRENCH_SAMPLE, wrench_sample_file
from crosspih_common.keys import Kind
from crosspih_common.recording.viewers import PREFIX

TRUTH_PREFIX = f"{PREFIX}truth/"  # what only the simulator knows
_FOXGLOVE = "foxglove."


@dataclass(frozen=True, slots=True)
class ViewerTopic:
    """One topic for viewers: its name, the full name of its protobuf message, and whether the last one stays valid."""

    name: str
    schema: str
    kind: Kind
    doc: str

    def channel_schema(self) -> tuple[str, str, str, bytes]:
        """(schema name, schema encoding, message encoding, schema bytes), as MCAP and the WebSocket want them."""
        return self.schema, "protobuf", "protobuf", _descriptors(self.schema)


TRANSFORMS = ViewerTopic(
    f"{PREFIX}transforms", "foxglove.FrameTransforms", Kind.STREAM,
    "every frame: base, link_1 ..., flange, ft, peg, tip, cameras, the hole as it is believed, and as it was expected",
)  # fmt: skip
ARM = ViewerTopic(f"{PREFIX}scene/arm", "foxglove.SceneUpdate", Kind.STATE, "the arm's links, tool and peg")
PLATE = ViewerTopic(f"{PREFIX}scene/plate", "foxglove.SceneUpdate", Kind.STATE, "the plate with the hole as drawn")
SURROUNDINGS = ViewerTopic(
    f"{PREFIX}scene/surroundings", "foxglove.SceneUpdate", Kind.STATE, "boxes and cylinders that the cell's file names"
)
FORCE = ViewerTopic(
    f"{PREFIX}scene/force", "foxglove.SceneUpdate", Kind.STREAM,
    "contact force as an arrow, 4 mm a newton, that ends where its line of action meets the plane of the tip; moment",
)  # fmt: skip
TOUCHES = ViewerTopic(
    f"{PREFIX}scene/touches", "foxglove.SceneUpdate", Kind.STATE, "each touch of this assembly, with its contact state"
)
ESTIMATE = ViewerTopic(
    f"{PREFIX}scene/estimate", "foxglove.SceneUpdate", Kind.STATE,
    "a ghost of the peg in the hole as it is believed, and the 95 % ellipsoid of its position, ten times as large",
)  # fmt: skip
JOINT_STATES = ViewerTopic(
    f"{PREFIX}joint_states", "foxglove.JointStates", Kind.STREAM, "the joints by the names of the URDF"
)
PEG_POSE = ViewerTopic(f"{PREFIX}pose/peg", "foxglove.PoseInFrame", Kind.STREAM, "the peg in the base frame")
HOLE_POSE = ViewerTopic(f"{PREFIX}pose/hole", "foxglove.PoseInFrame", Kind.STATE, "the hole as it is believed")
PLANNED = ViewerTopic(
    f"{PREFIX}path/planned", "foxglove.PosesInFrame", Kind.STATE, "the tip along the trajectory that was planned last"
)
TOUCHED = ViewerTopic(
    f"{PREFIX}path/touches", "foxglove.PosesInFrame", Kind.STATE, "the peg at each touch of this assembly"
)
CALIBRATION_LEFT = ViewerTopic(
    f"{PREFIX}camera/left/calibration", "foxglove.CameraCalibration", Kind.STATE, "the left camera"
)
CALIBRATION_RIGHT = ViewerTopic(
    f"{PREFIX}camera/right/calibration", "foxglove.CameraCalibration", Kind.STATE, "the right camera"
)
RIM_LEFT = ViewerTopic(
    f"{PREFIX}camera/left/rim", "foxglove.ImageAnnotations", Kind.STATE, "the hole's rims in the left picture"
)
RIM_RIGHT = ViewerTopic(
    f"{PREFIX}camera/right/rim", "foxglove.ImageAnnotations", Kind.STATE, "the hole's rims in the right picture"
)
WRENCH_RAW = ViewerTopic(
    f"{PREFIX}wrench/raw", WRENCH_SAMPLE, Kind.STREAM,
    "each sample of ft/raw, at the sensor's rate, as a load on the peg in its frame; bias and weight are in it",
)  # fmt: skip
WRENCH_CONTACT = ViewerTopic(
    f"{PREFIX}wrench/contact", WRENCH_SAMPLE, Kind.STREAM, "contact alone, at the rate of force_torque/wrench"
)
LOG = ViewerTopic(f"{PREFIX}log", "foxglove.Log", Kind.EVENT, "phases, events and refusals, with their service")
TRUTH_TRANSFORMS = ViewerTopic(
    f"{TRUTH_PREFIX}transforms", "foxglove.FrameTransforms", Kind.STREAM, "SIMULATOR'S TRUTH: truth_hole, truth_peg"
)
TRUTH_RIM = ViewerTopic(f"{TRUTH_PREFIX}rim", "foxglove.SceneUpdate", Kind.STATE, "SIMULATOR'S TRUTH: the real rim")
TRUTH_CONTACTS = ViewerTopic(
    f"{TRUTH_PREFIX}contacts", "foxglove.SceneUpdate", Kind.STATE, "SIMULATOR'S TRUTH: the real contacts and forces"
)


def viewer_topics() -> Iterator[ViewerTopic]:
    """Every topic of the table."""
    yield from (value for value in globals().values() if isinstance(value, ViewerTopic))


@lru_cache(maxsize=64)
def _descriptors(schema: str) -> bytes:
    if schema == WRENCH_SAMPLE:
        return wrench_sample_file().SerializeToString()
    name = schema.removeprefix(_FOXGLOVE)
    return descriptor_set(import_module(f"foxglove_schemas_protobuf.{name}_pb2").DESCRIPTOR)


def descriptor_set(file: FileDescriptor) -> bytes:
    """A protobuf file with all that it imports, as a serialized FileDescriptorSet."""
    descriptors = FileDescriptorSet()
    _with_imports(file, descriptors)
    return descriptors.SerializeToString()


def _with_imports(file: FileDescriptor, into: FileDescriptorSet) -> None:
    if any(known.name == file.name for known in into.file):
        return
    for dependency in file.dependencies:
        _with_imports(dependency, into)
    file.CopyToProto(into.file.add())
