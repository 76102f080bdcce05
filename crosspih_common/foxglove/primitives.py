"""Small pieces of Foxglove's protobuf messages, from poses and arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import sqrt
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import ArrayLike

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import PoseData

Rgba = tuple[float, float, float, float]
SHORTEST_M = 1e-6
OPPOSITE = 1e-9


def stamp(stamp_ns: int) -> Timestamp:
    """The cell's time as protobuf has it."""
    seconds, nanos = divmod(max(stamp_ns, 0), 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


def vector(values: Sequence[float] | Array) -> Vector3:
    """(3,) as Vector3."""
    x, y, z = values
    return Vector3(x=float(x), y=float(y), z=float(z))


def color(rgba: Rgba) -> Color:
    """Red, green, blue, opacity: 0 to 1."""
    return Color(r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3])


def pose_message(pose: Pose | PoseData) -> PoseMessage:
    """A Pose or a PoseData as Foxglove's Pose."""
    data = pose if isinstance(pose, PoseData) else PoseData.of(pose)
    x, y, z, w = data.quaternion_xyzw
    return PoseMessage(position=vector(data.position_m), orientation=Quaternion(x=x, y=y, z=z, w=w))


def along(direction: ArrayLike, origin_m: ArrayLike, axis: Sequence[float] = (0.0, 0.0, 1.0)) -> PoseMessage:
    """A pose at a point whose `axis`, a unit vector, points along a direction (3,) of any length but zero."""
    x, y, z = np.asarray(direction, float).tolist()
    length = sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    a, b, c = axis
    # half of the way from the axis to the direction (Shoemake): (axis x direction, 1 + axis . direction), made unit
    w = 1.0 + a * x + b * y + c * z
    if w < OPPOSITE:
        qx, qy, qz, w = (0.0, -c, b, 0.0) if abs(a) < 0.5 else (-b, a, 0.0, 0.0)
    else:
        qx, qy, qz = b * z - c * y, c * x - a * z, a * y - b * x
    norm = sqrt(qx * qx + qy * qy + qz * qz + w * w)
    turn = Quaternion(x=qx / norm, y=qy / norm, z=qz / norm, w=w / norm)
    return PoseMessage(position=vector(np.asarray(origin_m, float)), orientation=turn)


def at(position_m: ArrayLike) -> PoseMessage:
    """A pose at a point (3,), not turned."""
    return PoseMessage(position=vector(np.asarray(position_m, float)), orientation=Quaternion(w=1.0))


def entity(stamp_ns: int, frame: str, name: str, metadata: Iterable[tuple[str, str]] = ()) -> SceneEntity:
    """An entity that moves with its frame until another entity of the same name replaces it."""
    made = SceneEntity(timestamp=stamp(stamp_ns), frame_id=frame, id=name, frame_locked=True)
    for key, value in metadata:
        made.metadata.add(key=key, value=value)
    return made


def scene(entities: Iterable[SceneEntity], gone: Iterable[tuple[int, str]] = ()) -> bytes:
    """A SceneUpdate of entities, and of the names to delete, each with its time."""
    update: Any = SceneUpdate(entities=entities)
    for stamp_ns, name in gone:
        update.deletions.add(timestamp=stamp(stamp_ns), id=name)
    return bytes(update.SerializeToString())


def add_capsule(made: Any, ends_m: Array, radius_m: float, rgba: Rgba) -> None:
    """A cylinder between two points (2, 3) with a ball at each end."""
    length = float(np.linalg.norm(ends_m[1] - ends_m[0]))
    size = Vector3(x=2.0 * radius_m, y=2.0 * radius_m, z=length)
    if length > SHORTEST_M:
        pose = along(ends_m[1] - ends_m[0], ends_m.mean(axis=0))
        made.cylinders.add(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=color(rgba))
    ball = Vector3(x=2.0 * radius_m, y=2.0 * radius_m, z=2.0 * radius_m)
    for end in ends_m if length > SHORTEST_M else ends_m[:1]:
        made.spheres.add(pose=at(end), size=ball, color=color(rgba))


def add_arrow(made: Any, tail_m: ArrayLike, head_m: ArrayLike, width_m: float, rgba: Rgba) -> None:
    """An arrow from one point (3,) to another; none where they are the same."""
    tail, head = np.asarray(tail_m, float), np.asarray(head_m, float)
    length = float(np.linalg.norm(head - tail))
    if length < SHORTEST_M:
        return
    pointed = min(3.0 * width_m, 0.5 * length)
    made.arrows.add(
        pose=along(head - tail, tail, (1.0, 0.0, 0.0)), shaft_length=length - pointed,
        shaft_diameter=width_m, head_length=pointed, head_diameter=2.2 * width_m, color=color(rgba),
    )  # fmt: skip


def mesh(corners_m: Array, triangles: ArrayLike, rgba: Rgba) -> TriangleListPrimitive:
    """Triangles (m, 3) by the numbers of their corners (n, 3), counter-clockwise seen from outside."""
    return TriangleListPrimitive(
        pose=at((0.0, 0.0, 0.0)), points=points(corners_m), color=color(rgba),
        indices=[int(index) for index in np.asarray(triangles).ravel()],
    )  # fmt: skip


def points(corners_m: Array) -> list[Point3]:
    """(n, 3) as Point3."""
    return [Point3(x=x, y=y, z=z) for x, y, z in np.asarray(corners_m, float).tolist()]


def add_text(made: Any, text: str, at_m: Sequence[float] | Array, rgba: Rgba, size_px: float = 14.0) -> None:
    """A line of text that always faces the viewer, of a size on the screen."""
    made.texts.add(
        pose=at(at_m), billboard=True, scale_invariant=True,
        font_size=size_px, text=text, color=color(rgba),
    )  # fmt: skip
