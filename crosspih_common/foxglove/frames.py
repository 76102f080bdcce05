"""The arm's frames as Foxglove's FrameTransforms, and the peg's pose; published many times a second."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import numpy as np
from foxglove_schemas_protobuf.JointState_pb2 import JointState as JointStateMessage
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates

from crosspih_common.arm.description import default_joint_names, urdf_of
from crosspih_common.config import Workcell
from crosspih_common.foxglove.primitives import stamp
from crosspih_common.foxglove.wire import field, quaternion, stamp_field, text, vector3
from crosspih_common.geometry import Pose
from crosspih_common.messages import Frame, JointState, PoseData

BASE, FLANGE, FT, PEG, HOLE = (frame.value for frame in (Frame.BASE, Frame.FLANGE, Frame.FT, Frame.PEG, Frame.HOLE))
TIP, HOLE_EXPECTED = "tip", "hole_expected"
TRUTH_HOLE, TRUTH_PEG = "truth_hole", "truth_peg"
Vector = tuple[float, ...]


def link_frame(index: int) -> str:
    """The frame of a link, 0 the first one: that of its joint, as in the URDF."""
    return f"link_{index + 1}"


def arm_urdf(workcell: Workcell) -> str:
    """The arm as URDF, its links under the names of these frames."""
    model = workcell.arm()
    return urdf_of(model, default_joint_names(model), BASE, FLANGE)


class Placed:
    """Frames that are fixed in other frames until they are placed anew; written with a stamp on request."""

    def __init__(self) -> None:
        self._bodies: dict[str, bytes] = {}
        self.poses: dict[str, PoseData] = {}

    def place(self, child: str, parent: str, pose_parent_child: PoseData) -> None:
        """Place a frame in another one."""
        self.poses[child] = pose_parent_child
        self._bodies[child] = _body(
            _named(parent, child), pose_parent_child.position_m, pose_parent_child.quaternion_xyzw
        )

    def transforms(self, stamp_ns: int) -> bytes:
        """FrameTransforms of all. Several messages may be put one behind the other: protobuf adds up what repeats."""
        when = stamp_field(1, stamp_ns)
        return b"".join(field(1, when + body) for body in self._bodies.values())


def _named(parent: str, child: str) -> bytes:
    return text(2, parent) + text(3, child)


def _body(named: bytes, position_m: Sequence[float], quaternion_xyzw: Sequence[float]) -> bytes:
    """A foxglove.FrameTransform without its stamp."""
    return named + field(4, vector3(position_m)) + field(5, quaternion(quaternion_xyzw))


class ArmFrames:
    """The frames from the base to the tip, the joints by name, and the peg's pose."""

    def __init__(self, workcell: Workcell) -> None:
        model = workcell.arm()
        self._names = default_joint_names(model)
        self._links: list[tuple[bytes, Vector, Vector]] = []
        for index in range(model.joints):
            zero = Pose.from_rotvec([0.0, 0.0, float(model.zeros_rad[index])], np.zeros(3))
            pose = PoseData.of(model.fixed[index] @ zero)
            named = _named(link_frame(index - 1) if index else BASE, link_frame(index))
            self._links.append((named, pose.position_m, pose.quaternion_xyzw))
        flange, peg = PoseData.of(model.fixed[-1]), PoseData.of(workcell.pose_flange_peg())
        self._to_peg = (flange, peg)
        self._fixed = Placed()
        self._fixed.place(FLANGE, link_frame(model.joints - 1), flange)
        self._fixed.place(PEG, FLANGE, peg)
        self._fixed.place(FT, PEG, PoseData.of(workcell.sensor_mounting().pose_peg_sensor))
        self._fixed.place(TIP, PEG, PoseData.of(Pose.from_translation([0.0, 0.0, workcell.peg.shape().tip_m])))

    def transforms(self, stamp_ns: int, joints_rad: Sequence[float]) -> tuple[bytes, bytes]:
        """(FrameTransforms of all of them, PoseInFrame of the peg in the base) at these angles, rad."""
        when = stamp_field(1, stamp_ns)
        told: list[bytes] = []
        at: Vector = (0.0, 0.0, 0.0)
        turn: Vector = (0.0, 0.0, 0.0, 1.0)
        for (named, place, (a, b, c, d)), angle in zip(self._links, joints_rad, strict=True):
            s, w = sin(0.5 * angle), cos(0.5 * angle)
            # the fixed turn, then (0, 0, s, w) about the joint's own z
            own = (a * w + b * s, b * w - a * s, c * w + d * s, d * w - c * s)
            told.append(field(1, when + _body(named, place, own)))
            at, turn = _after(at, turn, place, own)
        for pose in self._to_peg:
            at, turn = _after(at, turn, pose.position_m, pose.quaternion_xyzw)
        posed = field(1, vector3(at)) + field(2, quaternion(turn))
        return b"".join(told) + self._fixed.transforms(stamp_ns), when + text(2, BASE) + field(3, posed)

    def joint_states(self, state: JointState, stamp_ns: int) -> bytes:
        """JointStates of one message."""
        joints = zip(self._names, state.joints_rad, state.speeds_rad_s, strict=True)
        message = JointStates(
            timestamp=stamp(stamp_ns),
            joints=[JointStateMessage(name=name, position=q, velocity=v) for name, q, v in joints],
        )
        return bytes(message.SerializeToString())


def _after(at: Vector, turn: Vector, place: Vector, own: Vector) -> tuple[Vector, Vector]:
    """The product of two poses: (position, quaternion)."""
    qx, qy, qz, qw = turn
    x, y, z = place
    # v + 2 q x (q x v + w v)
    tx, ty, tz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
    moved = (
        at[0] + x + qw * tx + qy * tz - qz * ty,
        at[1] + y + qw * ty + qz * tx - qx * tz,
        at[2] + z + qw * tz + qx * ty - qy * tx,
    )
    a, b, c, d = own
    turned = (
        qw * a + qx * d + qy * c - qz * b,
        qw * b - qx * c + qy * d + qz * a,
        qw * c + qx * b - qy * a + qz * d,
        qw * d - qx * a - qy * b - qz * c,
    )
    return moved, turned
