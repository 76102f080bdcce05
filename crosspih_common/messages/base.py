"""The root of every message, and the small parts that several messages share.

Units are SI and stand in the field names. `stamp_ns` is the cell's clock, `seq` counts a publisher's samples on one key
from 0 without gaps: both are filled by the bus when left at their defaults.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import Annotated, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Quaternion = Annotated[tuple[float, ...], Field(min_length=4, max_length=4)]
Vector6 = Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
# One number a joint: as many as the cell's arm has.
Joints = Annotated[tuple[float, ...], Field(min_length=6, max_length=7)]
# Row-major (6, 6) of a pose: order x, y, z, rx, ry, rz in the pose's own (child) frame, m and rad.
Covariance6 = Annotated[tuple[float, ...], Field(min_length=36, max_length=36)]


class Frame(str, Enum):
    """The frames of the cell, after the paper's Figure 1."""

    BASE = "base"  # {S}: the robot's base
    FLANGE = "flange"  # the last DH frame of the arm
    FT = "ft"  # {K}: where the F/T sensor measures, in its own axes
    PEG = "peg"  # {J}: origin of {K}, z along the peg axis towards the tip
    HOLE = "hole"  # {D}: centre of the rim on the outer face, z into the hole
    CAMERA_LEFT = "camera_left"  # {C1}: z forward, x right, y down
    CAMERA_RIGHT = "camera_right"  # {C2}


class Part(BaseModel):
    """A piece of a message: frozen, no unknown fields, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Message(Part):
    """What travels on the bus. Its type name and VERSION travel beside it and are checked on receipt."""

    VERSION: ClassVar[int] = 1

    stamp_ns: int = Field(default=-1, ge=-1, description="cell clock; -1 until the bus stamps it")
    seq: int = Field(default=-1, ge=-1, description="counts one publisher's samples on one key; -1 until sent")

    @classmethod
    def type_name(cls) -> str:
        """The name on the wire."""
        return f"crosspih.{cls.__name__}"


class PoseData(Part):
    """A pose on the wire; the field that holds it names both frames (`pose_base_hole`: hole in base)."""

    position_m: Vector3
    quaternion_xyzw: Quaternion

    @classmethod
    def of(cls, pose: Pose) -> PoseData:
        """From the geometry's Pose."""
        return cls(position_m=floats(pose.translation_m), quaternion_xyzw=floats(pose.quaternion_xyzw()))

    def pose(self) -> Pose:
        """To the geometry's Pose; the quaternion is normalised."""
        return Pose.from_quaternion(self.quaternion_xyzw, self.position_m)


def same_length(part: Part, first: str, *others: str) -> None:
    """ValueError where fields do not hold as many numbers as the first of them."""
    count = len(getattr(part, first))
    for name in others:
        if len(getattr(part, name)) != count:
            raise ValueError(f"{name} has {len(getattr(part, name))} numbers, {first} has {count}; give as many")


def floats(values: Iterable[float] | Array) -> tuple[float, ...]:
    """A flat tuple of plain floats from any array."""
    return tuple(float(value) for value in np.asarray(values, dtype=float).ravel())
