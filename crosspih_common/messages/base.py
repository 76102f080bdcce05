"""The root of every message, and the small parts that several messages share.

Units are SI and stand in the field names. `stamp_ns` is the cell's clock, `seq` counts a publisher's samples on one key
from 0 without gaps: both are filled by the bus when left at their defaults.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from crosspih_common.geometry import Pose
    from crosspih_common.geometry.pose import Array

# No length, angle, force or count that a cell can have is larger; what is, would overflow in the first square of it.
MAX_MAGNITUDE = 1e12
MAX_STAMP_NS = 2**62
MAX_SEQ = 2**53 - 1  # exact in every language's JSON
UNIT_TOLERANCE = 0.01  # quaternions are often sent with three decimals
SYMMETRY = 1e-6  # of an entry, times the two standard deviations
NEGATIVE = -1e-9  # an eigenvalue of a correlation may round to
SINGULAR = 1e-12  # one below says that a direction is known exactly


def _unit(quaternion_xyzw: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*quaternion_xyzw)
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise ValueError(f"has length {length:.3g}; give a unit quaternion (x, y, z, w)")
    return quaternion_xyzw


def _direction(vector: tuple[float, ...]) -> tuple[float, ...]:
    if math.hypot(*vector) < SINGULAR:
        raise ValueError("has no length; give the way to go in the base frame, any length")
    return vector


def _deviations(values: tuple[float, ...]) -> tuple[float, ...]:
    if min(values) < 0.0:
        raise ValueError(f"{min(values):.3g} is below 0; give standard deviations")
    return values


def _least_eigenvalue(values: tuple[float, ...]) -> float:
    """Of the correlation (6, 6). Raises ValueError where the variances or the symmetry are not a covariance's."""
    import numpy as np  # here and below: who only names a message, as `crosspih keys`, need not wait for NumPy

    covariance = np.asarray(values).reshape(6, 6)
    variances = np.diag(covariance)
    if (variances < 0.0).any():
        raise ValueError(f"variance {int(np.argmin(variances))} on its diagonal is {variances.min():.3g}, below 0")
    scales = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    with np.errstate(over="ignore"):
        correlation = covariance / scales[:, None] / scales[None, :]
    if not np.isfinite(correlation).all():
        raise ValueError("has an entry beyond all that its two variances allow: no covariance is so")
    if np.abs(correlation - correlation.T).max() > SYMMETRY:
        raise ValueError("is not symmetric; give it row by row, order x, y, z, rx, ry, rz")
    return float(np.linalg.eigvalsh(correlation)[0])


def _covariance(values: tuple[float, ...]) -> tuple[float, ...]:
    if _least_eigenvalue(values) < NEGATIVE:
        raise ValueError("has a negative eigenvalue: no covariance is so")
    return values


def _definite(values: tuple[float, ...]) -> tuple[float, ...]:
    if _least_eigenvalue(values) < SINGULAR or min(values[::7]) <= 0.0:
        raise ValueError("is singular: nothing is known exactly; give each direction a variance above 0")
    return values


def _said(what: str) -> Any:
    """What pydantic cannot say in a JSON schema by itself: as its `format`."""
    return Field(json_schema_extra={"format": what})


Number = Annotated[float, Field(ge=-MAX_MAGNITUDE, le=MAX_MAGNITUDE)]
Vector3 = Annotated[tuple[Number, ...], Field(min_length=3, max_length=3)]
MAX_PLACE_M = 100.0  # from any frame of one cell to another
Position3 = Annotated[
    tuple[Annotated[float, Field(ge=-MAX_PLACE_M, le=MAX_PLACE_M)], ...], Field(min_length=3, max_length=3)
]
Direction = Annotated[Vector3, AfterValidator(_direction), _said("direction")]  # of any length but none
Quaternion = Annotated[
    tuple[Number, ...], Field(min_length=4, max_length=4), AfterValidator(_unit), _said("unit_quaternion")
]
Vector6 = Annotated[tuple[Number, ...], Field(min_length=6, max_length=6)]
# A sensor's own numbers, counts among them; what is made of them stays within MOST.
RawNumber = Annotated[float, Field(ge=-1e9, le=1e9)]
RawVector6 = Annotated[tuple[RawNumber, ...], Field(min_length=6, max_length=6)]
Deviations6 = Annotated[RawVector6, AfterValidator(_deviations), _said("standard_deviations")]
# One number a joint: as many as the cell's arm has.
Joints = Annotated[tuple[Number, ...], Field(min_length=6, max_length=7)]
# Row-major (6, 6) of a pose: order x, y, z, rx, ry, rz in the pose's own (child) frame, m and rad.
Covariance6 = Annotated[
    tuple[Number, ...], Field(min_length=36, max_length=36), AfterValidator(_covariance), _said("covariance")
]
# As what an estimate starts from: no direction may be known exactly.
PriorCovariance6 = Annotated[Covariance6, AfterValidator(_definite)]


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

    stamp_ns: int = Field(default=-1, ge=-1, le=MAX_STAMP_NS, description="cell clock; -1 until the bus stamps it")
    seq: int = Field(
        default=-1, ge=-1, le=MAX_SEQ, description="counts one publisher's samples on one key; -1 until sent"
    )

    @classmethod
    def type_name(cls) -> str:
        """The name on the wire."""
        return f"crosspih.{cls.__name__}"


class PoseData(Part):
    """A pose on the wire; the field that holds it names both frames (`pose_base_hole`: hole in base)."""

    position_m: Position3
    quaternion_xyzw: Quaternion

    @classmethod
    def of(cls, pose: Pose) -> PoseData:
        """From the geometry's Pose."""
        return cls(position_m=floats(pose.translation_m), quaternion_xyzw=floats(pose.quaternion_xyzw()))

    def pose(self) -> Pose:
        """To the geometry's Pose; the quaternion is normalised."""
        from crosspih_common.geometry import Pose

        return Pose.from_quaternion(self.quaternion_xyzw, self.position_m)


def same_length(part: Part, first: str, *others: str) -> None:
    """ValueError where fields do not hold as many numbers as the first of them."""
    count = len(getattr(part, first))
    for name in others:
        if len(getattr(part, name)) != count:
            raise ValueError(f"{name} has {len(getattr(part, name))} numbers, {first} has {count}; give as many")


def floats(values: Iterable[float] | Array) -> tuple[float, ...]:
    """A flat tuple of plain floats from any array."""
    import numpy as np

    return tuple(np.asarray(values, dtype=float).ravel().tolist())
