"""The cell's frames by their ROS names, and the arm by its joints and links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from crosspih_common.arm.description import UrdfChain, default_joint_names, urdf_of
from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import Frame

BASE_LINK, TOOL0 = "base_link", "tool0"


@dataclass(frozen=True, slots=True)
class RosFrames:
    """`base` and `flange` as ROS names them; the others as the cell does."""

    base: str = BASE_LINK
    flange: str = TOOL0

    def of(self, frame: str) -> str:
        """A frame of the cell by its name in ROS."""
        return {Frame.BASE.value: self.base, Frame.FLANGE.value: self.flange}.get(frame, frame)


@dataclass(frozen=True, slots=True, eq=False)
class RosArm:
    """The arm's URDF text, the chain from base to flange, and the frames at both ends."""

    urdf: str
    chain: UrdfChain
    frames: RosFrames


def ros_arm(
    workcell: Workcell, field: str, joint_names: Sequence[str] | None = None, base: str | None = None,
    flange: str | None = None,
) -> RosArm:  # fmt: skip
    """The cell's arm for ROS: the cell's URDF file, or a URDF written from the arm's model.

    `field` is the section whose `joint_names`, `base_frame`, `flange_frame` these are. Raises ConfigError.
    """
    model, section = workcell.arm(), workcell.arm_section
    if section.urdf is not None:
        for name, value in (("joint_names", joint_names), ("base_frame", base), ("flange_frame", flange)):
            if value is not None:
                raise ConfigError(f"{field}.{name}: the URDF file of cell.arm says it; leave it out")
        text = Path(section.urdf).read_text(encoding="utf-8")
        chain = UrdfChain.of(text, section.base_link, section.tip_link)
        return RosArm(text, chain, RosFrames(chain.joints[0].parent, chain.joints[-1].child))
    names = tuple(joint_names or default_joint_names(model))
    if len(names) != model.joints or len(set(names)) != model.joints:
        raise ConfigError(f"{field}.joint_names: {len(names)} names, want {model.joints} that differ, base first")
    frames = RosFrames(base or BASE_LINK, flange or TOOL0)
    text = urdf_of(model, names, frames.base, frames.flange)
    return RosArm(text, UrdfChain.of(text), frames)
