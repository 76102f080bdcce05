"""The arm of a cell, as its file gives it: a name, a DH table or a URDF file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from crosspih_common.arm import NAMED_ARMS, ArmModel, JointLimits, named_arm
from crosspih_common.arm.errors import WITHOUT_PIN
from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section
from crosspih_common.messages.base import Joints

ArmName = Literal["xb4", "ur5e", "panda"]
LIMITS = ("lower_rad", "upper_rad", "speed_rad_s", "acceleration_rad_s2")
DhRow = tuple[float, float, float, float]


class ArmSection(Section):
    """One of `name`, `dh` and `urdf`; limits given here replace those of a named arm or of the URDF file."""

    name: ArmName | None = None
    dh: tuple[DhRow, ...] | None = Field(
        default=None, min_length=6, max_length=7, description="a row a joint: theta offset, d, a, alpha, rad and m"
    )
    dh_convention: Literal["standard", "modified"] = "standard"
    last_to_flange: Placement | None = Field(
        default=None, description="the flange in the last frame of a modified DH table"
    )
    urdf: str | None = Field(default=None, min_length=1, description="a file, from the folder of the cell's file")
    base_link: str | None = Field(default=None, description="of the URDF file; its root where not given")
    tip_link: str | None = Field(default=None, description="of the URDF file: the flange; its last link if only one")
    lower_rad: Joints | None = None
    upper_rad: Joints | None = None
    speed_rad_s: Joints | None = None
    acceleration_rad_s2: Joints | None = None
    link_radii_m: Joints | None = Field(default=None, description="of a capsule about each link, for clearance")

    @model_validator(mode="after")
    def _can_be_made(self) -> ArmSection:
        given = [name for name in ("name", "dh", "urdf") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "wants one of name (xb4, ur5e, panda), dh (a table) and urdf (a file), got "
                + (" and ".join(given) or "none")
            )
        for field, of in (("base_link", "urdf"), ("tip_link", "urdf"), ("last_to_flange", "dh")):
            if getattr(self, field) is not None and of not in given:
                raise ValueError(f"{field} means nothing without {of}; leave it out")
        if self.last_to_flange is not None and self.dh_convention == "standard":
            raise ValueError("last_to_flange means nothing in a standard DH table, whose last row ends at the flange")
        if self.dh is not None:
            missing = [name for name in LIMITS if getattr(self, name) is None]
            if missing:
                raise ValueError(f"a DH table says nothing of limits; give {', '.join(missing)} as well")
        self.model()
        return self

    def model(self) -> ArmModel:
        """The arm; the same object for equal sections. ValueError where it cannot be made."""
        return _arm(self)


def default_joints(arm: Any, field: str) -> tuple[float, ...] | None:
    """The default home posture or joint stiffness of the arm named in a raw section `cell.arm`; None without a name.

    `field` is "home_rad" or "stiffness_nm_rad".
    """
    if isinstance(arm, dict):
        try:
            arm = ArmSection.model_validate(arm)
        except ValidationError:
            return None
    if not isinstance(arm, ArmSection) or arm.name is None:
        return None
    return tuple(getattr(NAMED_ARMS[arm.name], field))


def with_urdf_beside(path: Path, cell: dict[str, Any]) -> dict[str, Any]:
    """The cell's raw section; a relative path of the arm's URDF file is resolved from the folder of the cell's file."""
    arm = cell.get("arm")
    if not isinstance(arm, dict) or not isinstance(arm.get("urdf"), str):
        return cell
    return {**cell, "arm": {**arm, "urdf": str(path.parent / arm["urdf"])}}


@lru_cache(maxsize=32)
def _arm(section: ArmSection) -> ArmModel:
    radii = np.asarray(section.link_radii_m or (), float)
    changed = {name: np.asarray(value) for name in LIMITS if (value := getattr(section, name)) is not None}
    if section.urdf is not None:
        # pin is an optional extra: an arm without a URDF file does not need it
        try:
            from crosspih_common.arm.urdf import arm_from_urdf
        except ImportError as error:
            raise ValueError(f"{WITHOUT_PIN} ({error})") from None
        return arm_from_urdf(section.urdf, section.base_link, section.tip_link, changed, radii)
    if section.dh is not None:
        limits = JointLimits(**changed)
        if section.dh_convention == "standard":
            return ArmModel.from_dh("dh", section.dh, limits, link_radii_m=radii)
        flange = None if section.last_to_flange is None else section.last_to_flange.pose()
        return ArmModel.from_modified_dh("dh", section.dh, limits, pose_last_flange=flange, link_radii_m=radii)
    assert section.name is not None
    arm = named_arm(section.name)
    if not changed and not radii.size:
        return arm
    return arm.changed(changed, radii)
