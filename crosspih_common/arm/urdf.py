"""An arm from a URDF file, read by Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from crosspih_common.arm.kinematics import ArmModel, JointLimits
from crosspih_common.geometry.pose import Array, Pose

ACCELERATION_RAD_S2 = 10.0
"""What is taken for the acceleration of each joint: a URDF does not say."""


def arm_from_urdf(
    path: str | Path,
    base_link: str | None = None,
    tip_link: str | None = None,
    limits: Mapping[str, ArrayLike] | None = None,
    link_radii_m: ArrayLike = (),
) -> ArmModel:
    """The chain of revolute joints from one link (default: the file's root) to another (default: the only last one).

    `limits` replaces some of the file's, by the names of `JointLimits`. Joints off the chain, of a gripper for example,
    are left out; a continuous joint may turn a full turn each way.

    ValueError where there is no such file, link or chain, or where the chain does not hold 6 or 7 revolute joints.
    """
    path = Path(path)
    try:
        model = pinocchio.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{path}: cannot be read as URDF ({str(error).splitlines()[0]})") from None
    links = [frame.name for frame in model.frames if frame.type == pinocchio.FrameType.BODY]
    tip = _link(path, model, links, "tip_link", _last_link(path, model) if tip_link is None else tip_link)
    base = _link(path, model, links, "base_link", links[0] if base_link is None else base_link)
    chain = _chain(path, model, base, tip)
    name = model.name or path.stem

    turned = [_axis_to_z(path, model, joint) for joint in chain]
    between = [_pose(model.jointPlacements[joint]) for joint in chain]
    # the base link may be placed in its own joint's frame (or the root), the tip in the last joint's
    between[0] = _pose(model.frames[base].placement).inverse() @ between[0]
    fixed = [between[0] @ turned[0]]
    for index in range(1, len(chain)):
        fixed.append(turned[index - 1].inverse() @ between[index] @ turned[index])
    fixed.append(turned[-1].inverse() @ _pose(model.frames[tip].placement))

    lower, upper, speed = _ranges(model, chain)
    found = JointLimits(lower, upper, speed, np.full(len(chain), ACCELERATION_RAD_S2))
    return ArmModel(name, tuple(fixed), np.zeros(len(chain)), found).changed(limits or {}, link_radii_m)


def _pose(placement: pinocchio.SE3) -> Pose:
    return Pose(np.array(placement.rotation), np.array(placement.translation))


def _link(path: Path, model: pinocchio.Model, links: list[str], field: str, name: str) -> int:
    if name not in links:
        raise ValueError(f"{field}: {path} has no link {name!r}; want one of {', '.join(links)}")
    return int(model.getFrameId(name, pinocchio.FrameType.BODY))


def _last_link(path: Path, model: pinocchio.Model) -> str:
    """The only link without a child link."""
    bodies = [index for index, frame in enumerate(model.frames) if frame.type == pinocchio.FrameType.BODY]
    parents = {model.frames[index].parentFrame for index in range(len(model.frames)) if index}
    last = [model.frames[index].name for index in bodies if index not in parents]
    if len(last) != 1:
        raise ValueError(f"tip_link: {path} ends in {', '.join(last)}; name the one that is the flange")
    return str(last[0])


def _chain(path: Path, model: pinocchio.Model, base: int, tip: int) -> list[int]:
    start, joint, chain = model.frames[base].parentJoint, model.frames[tip].parentJoint, []
    while joint not in (start, 0):
        chain.append(int(joint))
        joint = model.parents[joint]
    ends = f"from {model.frames[base].name!r} to {model.frames[tip].name!r}"
    if joint != start:
        raise ValueError(f"tip_link: no chain of joints leads {ends} in {path}")
    if len(chain) not in (6, 7):
        raise ValueError(f"tip_link: {len(chain)} joints lead {ends} in {path}, want 6 or 7")
    return chain[::-1]


def _axis_to_z(path: Path, model: pinocchio.Model, joint: int) -> Pose:
    """`pose_joint_axis`: a frame at the joint whose z axis is the axis that it turns about."""
    if model.joints[joint].nv != 1:
        raise ValueError(f"{path}: joint {model.names[joint]!r} has {model.joints[joint].nv} freedoms, want revolute")
    data = model.createData()
    local = pinocchio.computeJointJacobian(model, data, pinocchio.neutral(model), joint)
    motion = local[:, model.joints[joint].idx_v]
    axis = motion[3:]
    if np.linalg.norm(motion[:3]) > 1e-12 or abs(float(np.linalg.norm(axis)) - 1.0) > 1e-9:
        raise ValueError(f"{path}: joint {model.names[joint]!r} slides, want revolute joints only")
    z = np.array([0.0, 0.0, 1.0])
    turn = np.cross(z, axis)
    sine, cosine = float(np.linalg.norm(turn)), float(axis[2])
    if sine < 1e-12:
        return Pose.from_rotvec([0.0 if cosine > 0.0 else np.pi, 0.0, 0.0], np.zeros(3))
    return Pose.from_rotvec(turn / sine * np.arctan2(sine, cosine), np.zeros(3))


def _ranges(model: pinocchio.Model, chain: list[int]) -> tuple[Array, Array, Array]:
    lower, upper, speed = [], [], []
    for joint in chain:
        q, v = model.joints[joint].idx_q, model.joints[joint].idx_v
        continuous = model.joints[joint].nq == 2
        lower.append(-2.0 * np.pi if continuous else float(model.lowerPositionLimit[q]))
        upper.append(2.0 * np.pi if continuous else float(model.upperPositionLimit[q]))
        speed.append(float(model.upperVelocityLimit[v]))
    return np.array(lower), np.array(upper), np.array(speed)
