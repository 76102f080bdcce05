"""An arm as a URDF text, and the chain of a URDF text: names of joints and links, and where each link stands.

Used where the arm is shown or described by its parts, as in ROS 2. The kinematics are those of `ArmModel`; the URDF
text that `urdf_of` writes has exactly the same.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.arm.kinematics import ArmModel
from crosspih_common.geometry.pose import Array, Pose
from crosspih_common.geometry.rotation import rotations

SHORTEST_LINE_M = 1e-3
# the makers' names of the joints, base first
JOINT_NAMES = {
    "ur5e": ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
             "wrist_3_joint"),
    "panda": tuple(f"panda_joint{index}" for index in range(1, 8)),
}  # fmt: skip


def default_joint_names(model: ArmModel) -> tuple[str, ...]:
    """The maker's names of the joints of a named arm; joint_1, joint_2 ... of any other."""
    names = JOINT_NAMES.get(model.name, ())
    return names if len(names) == model.joints else tuple(f"joint_{index}" for index in range(1, model.joints + 1))


def urdf_of(model: ArmModel, joint_names: Sequence[str], base_link: str, tip_link: str) -> str:
    """The arm as URDF: each link is the cylinder of its capsule, no masses. ValueError for a wrong number of names."""
    if len(joint_names) != model.joints:
        raise ValueError(f"{len(joint_names)} joint names for the {model.joints} joints of the arm {model.name!r}")
    robot = ET.Element("robot", name=model.name)
    ET.SubElement(robot, "link", name=base_link)
    parent = base_link
    limits = model.limits
    for index, name in enumerate(joint_names):
        link = f"link_{index + 1}"
        joint = ET.SubElement(robot, "joint", name=name, type="revolute")
        # R(q + zero) = R(zero) R(q)
        turned = Pose.from_rotvec([0.0, 0.0, float(model.zeros_rad[index])], np.zeros(3))
        _origin(joint, model.fixed[index] @ turned)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=link)
        ET.SubElement(joint, "axis", xyz="0 0 1")
        ET.SubElement(
            joint, "limit", lower=repr(float(limits.lower_rad[index])), upper=repr(float(limits.upper_rad[index])),
            velocity=repr(float(limits.speed_rad_s[index])), effort="0",
        )  # fmt: skip
        element = ET.SubElement(robot, "link", name=link)
        ends = model.fixed[index + 1].apply(model.link_lines_m[index])
        _cylinder(element, ends, float(model.link_radii_m[index]))
        parent = link
    fixed = ET.SubElement(robot, "joint", name=f"{tip_link}_fixed", type="fixed")
    _origin(fixed, model.fixed[-1])
    ET.SubElement(fixed, "parent", link=parent)
    ET.SubElement(fixed, "child", link=tip_link)
    ET.SubElement(robot, "link", name=tip_link)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def _origin(element: ET.Element, pose: Pose) -> None:
    # URDF's rpy: about the fixed x, then y, then z
    angles = rotations().from_matrix(pose.rotation).as_euler("xyz", suppress_warnings=True)
    ET.SubElement(element, "origin", xyz=_numbers(pose.translation_m), rpy=_numbers(angles))


def _numbers(values: ArrayLike) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values))


def _cylinder(link: ET.Element, ends: Array, radius_m: float) -> None:
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    for kind in ("visual", "collision"):
        element = ET.SubElement(link, kind)
        if length < SHORTEST_LINE_M:
            _origin(element, Pose.from_translation(ends.mean(axis=0)))
            ET.SubElement(ET.SubElement(element, "geometry"), "sphere", radius=repr(radius_m))
            continue
        turn, _ = rotations().align_vectors(along[None] / length, [[0.0, 0.0, 1.0]])
        _origin(element, Pose(turn.as_matrix(), ends.mean(axis=0)))
        ET.SubElement(ET.SubElement(element, "geometry"), "cylinder", radius=repr(radius_m), length=repr(length))


@dataclass(frozen=True, slots=True, eq=False)
class UrdfJoint:
    """One joint: `pose_parent_joint` at angle 0, and its axis of rotation (3,); None for a fixed joint."""

    name: str
    parent: str
    child: str
    pose_parent_joint: Pose
    axis: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class UrdfChain:
    """The joints that lead from one link of a URDF to another, fixed ones among them."""

    joints: tuple[UrdfJoint, ...]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the joints that turn, base first."""
        return tuple(joint.name for joint in self.joints if joint.axis is not None)

    def poses(self, joints_rad: ArrayLike) -> list[Pose]:
        """`pose_parent_child` of every joint, fixed ones too, at the angles (n,), rad, of those that turn."""
        angles = iter(np.asarray(joints_rad, float).tolist())
        found = []
        for joint in self.joints:
            pose = joint.pose_parent_joint
            if joint.axis is not None:
                pose = pose @ Pose.from_rotvec(joint.axis * next(angles), np.zeros(3))
            found.append(pose)
        return found

    @classmethod
    def of(cls, text: str, base_link: str | None = None, tip_link: str | None = None) -> UrdfChain:
        """The chain from the root (or `base_link`) to the only leaf link (or `tip_link`).

        Raises ValueError that names a missing link.
        """
        try:
            root = ET.fromstring(text)
        except ET.ParseError as error:
            raise ValueError(f"the URDF is no XML: {error}") from None
        joints = {joint.child: joint for joint in map(_joint, root.findall("joint"))}
        links = [link.get("name", "") for link in root.findall("link")]
        parents = {joint.parent for joint in joints.values()}
        tip = tip_link or _only([link for link in links if link not in parents], "tip_link")
        base = base_link or _only([link for link in links if link not in joints], "base_link")
        chain: list[UrdfJoint] = []
        link = tip
        while link != base:
            if link not in joints:
                raise ValueError(f"no chain of joints leads from {base!r} to {tip!r}")
            chain.append(joints[link])
            link = chain[-1].parent
        return cls(tuple(reversed(chain)))


def _only(links: list[str], field: str) -> str:
    if len(links) != 1:
        raise ValueError(f"{field}: the URDF has {len(links)} such links ({', '.join(links)}); name one")
    return links[0]


def _joint(element: ET.Element) -> UrdfJoint:
    name, kind = element.get("name", ""), element.get("type", "")
    parent, child, origin, axis = (element.find(tag) for tag in ("parent", "child", "origin", "axis"))
    if parent is None or child is None:
        raise ValueError(f"joint {name!r} has no parent or no child")
    xyz, rpy = ((origin.get(key) if origin is not None else None) or "0 0 0" for key in ("xyz", "rpy"))
    rotation = rotations().from_euler("xyz", [float(value) for value in rpy.split()]).as_matrix()
    about = None
    if kind in ("revolute", "continuous"):
        said = (axis.get("xyz") if axis is not None else None) or "1 0 0"
        given = np.array([float(value) for value in said.split()])
        about = given / np.linalg.norm(given)
    pose = Pose(rotation, np.array([float(value) for value in xyz.split()]))
    return UrdfJoint(name, parent.get("link", ""), child.get("link", ""), pose, about)
