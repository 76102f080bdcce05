"""The nominal data of a cell that every service knows: drawings, mounting, expected pose of the hole. The simulator's
true values are not here: on a real cell these data come from data sheets, CAD drawings and a tape measure."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from crosspih_common.arm import NAMED_ARMS, ArmModel
from crosspih_common.config.arm import ArmSection, default_joints
from crosspih_common.config.camera import CameraSection
from crosspih_common.config.drawing import HoleDrawing, PegDrawing
from crosspih_common.config.force_torque import SensorSection
from crosspih_common.config.name import DEFAULT_NAME, NAME
from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section
from crosspih_common.config.surroundings import Surroundings
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.base import Joints, Vector3
from crosspih_common.wrench import PayloadLimits, SensorMounting


class HolePrior(Section):
    """The expected pose of the hole: nominal pose and half ranges of the deviation, about the nominal hole's axes."""

    # T0 of the paper (its Eq. 13, signs restored), made orthonormal
    matrix_base_hole: tuple[tuple[float, float, float, float], ...] = (
        (-0.07, 0.06, 1.0, 0.4),
        (-0.06, -1.0, 0.06, -0.3),
        (1.0, -0.06, 0.07, 0.2),
    )
    half_range_lateral_m: float = Field(default=0.010, gt=0.0)
    half_range_depth_m: float = Field(default=0.015, gt=0.0)
    half_range_rotation_rad: float = Field(default=0.1, gt=0.0)

    def pose_base_hole(self) -> Pose:
        """The nominal hole in the base frame."""
        return Pose.from_matrix([*self.matrix_base_hole, (0.0, 0.0, 0.0, 1.0)])

    def half_ranges(self) -> Array:
        """(6,): x, y, z in m, rx, ry, rz in rad."""
        lateral, depth, turn = self.half_range_lateral_m, self.half_range_depth_m, self.half_range_rotation_rad
        return np.array([lateral, lateral, depth, turn, turn, turn])


class Workcell(Section):
    """The facts of one cell."""

    name: str = Field(default=DEFAULT_NAME, pattern=NAME, description="the key prefix")
    peg: PegDrawing = PegDrawing()
    hole: HoleDrawing = HoleDrawing()
    hole_prior: HolePrior = HolePrior()
    arm_section: ArmSection = Field(default=ArmSection(name="xb4"), alias="arm")
    camera: CameraSection = CameraSection()
    surroundings: Surroundings = Surroundings()
    # from the flange to {K}, where the sensor measures; the tip is then 0.146 m past the flange
    flange_to_ft: Placement = Placement(position_m=(0.0, 0.0, 0.0663))
    flange_to_ft_m: float | None = Field(default=None, gt=0.0, description="flange_to_ft, where it is only along z")
    # both with one number a joint; where not given, those of the arm that `arm` names
    home_joints_rad: Joints = NAMED_ARMS["xb4"].home_rad
    # elasticity between the encoders and the links; about 100 N/mm at the tool in front of the hole
    joint_stiffness_nm_rad: Joints = NAMED_ARMS["xb4"].stiffness_nm_rad
    contact_stiffness_n_m: float | None = Field(
        default=None, ge=1e3, le=1e9,
        description="of one contact point of peg and hole, along its normal: how soft peg, plate and what holds them "
        "are, in series. None: the arm alone gives way",
    )  # fmt: skip
    gravity_base_m_s2: Vector3 = (0.0, 0.0, -9.81)
    force_torque: SensorSection = SensorSection()
    # dry friction to expect between peg and hole; the estimator measures it from the touches
    friction_expected: float = Field(default=0.1, ge=0.0, le=1.0)
    # how deep the body must be in its bore to count as inserted
    insertion_depth_m: float = Field(default=0.015, gt=0.0)

    @model_validator(mode="before")
    @classmethod
    def _of_the_arm(cls, data: Any) -> Any:
        """Fill in home and stiffness of the named arm if the file does not give them."""
        if not isinstance(data, dict) or "arm" not in data:
            return data
        data = dict(data)
        for field, of in (("home_joints_rad", "home_rad"), ("joint_stiffness_nm_rad", "stiffness_nm_rad")):
            default = default_joints(data["arm"], of)
            if data.get(field) is None and default is not None:
                data[field] = default
        return data

    @model_validator(mode="after")
    def _arm_can_stand(self) -> Workcell:
        arm = self.arm()
        for field in ("home_joints_rad", "joint_stiffness_nm_rad"):
            given = len(getattr(self, field))
            if field not in self.model_fields_set and "arm_section" in self.model_fields_set:
                raise ValueError(f"{field}: the arm {arm.name!r} has none of its own; give {arm.joints} numbers")
            if given != arm.joints:
                raise ValueError(f"{field}: has {given} numbers, give {arm.joints}: the arm has {arm.joints} joints")
        lines = arm.limits.violations(self.home_joints_rad)
        if lines:
            raise ValueError(f"home_joints_rad: {'; '.join(lines)}; move it inside")
        if min(self.joint_stiffness_nm_rad) <= 0.0:
            raise ValueError("joint_stiffness_nm_rad: wants numbers above 0")
        if self.flange_to_ft_m is not None and "flange_to_ft" in self.model_fields_set:
            raise ValueError("flange_to_ft_m: says the same as flange_to_ft; leave it out")
        return self

    @model_validator(mode="after")
    def _hole_can_be_made(self) -> Workcell:
        self.hole.shape(self.peg.shape())
        return self

    @field_validator("gravity_base_m_s2")
    @classmethod
    def _pulls_somewhere(cls, gravity: tuple[float, ...]) -> tuple[float, ...]:
        if not 1.0 <= float(np.linalg.norm(gravity)) <= 30.0:
            raise ValueError("wants an acceleration of 1 to 30 m/s2, the way things fall; on Earth its length is 9.81")
        return gravity

    def arm(self) -> ArmModel:
        """The arm's kinematics and limits; always the same object."""
        return self.arm_section.model()

    def pose_flange_peg(self) -> Pose:
        """The peg frame {J} = {K} in the flange frame."""
        if self.flange_to_ft_m is not None:
            return Pose.from_translation([0.0, 0.0, self.flange_to_ft_m])
        return self.flange_to_ft.pose()

    def pose_base_peg(self, joints_rad: Array | tuple[float, ...]) -> Pose:
        """Forward kinematics up to the peg frame."""
        return self.arm().pose_base_flange(joints_rad) @ self.pose_flange_peg()

    def compliance_peg(self, joints_rad: Array | tuple[float, ...]) -> Array:
        """(6, 6): `arm_compliance_peg` in series with the contact's compliance, if one is declared.

        It relates a peg that touches at one point to its pose against a rigid plate: the contact's spring moves it
        along the force, wherever the point is. Several contact points together are stiffer.
        """
        compliance = self.arm_compliance_peg(joints_rad)
        if self.contact_stiffness_n_m is not None:
            compliance[:3, :3] += np.eye(3) / self.contact_stiffness_n_m
        return compliance

    def arm_compliance_peg(self, joints_rad: Array | tuple[float, ...]) -> Array:
        """(6, 6): the displacement of the peg frame (x, y, z, rx, ry, rz, in the peg frame) per unit wrench on the peg.

        C = J K^-1 J^T with the Jacobian of the peg frame's origin (Salisbury 1980): the arm alone.
        """
        jacobian = self.arm().jacobian(joints_rad, self.pose_flange_peg())
        rotation = self.pose_base_peg(joints_rad).rotation
        to_peg = np.zeros((6, 6))
        to_peg[:3, :3] = rotation.T
        to_peg[3:, 3:] = rotation.T
        local = to_peg @ jacobian
        return np.asarray(local @ np.diag(1.0 / np.asarray(self.joint_stiffness_nm_rad)) @ local.T)

    def sensor_mounting(self) -> SensorMounting:
        """How raw readings of the force/torque sensor become wrenches on the peg."""
        return self.force_torque.mounting(self.pose_flange_peg())

    def payload_limits(self) -> PayloadLimits:
        """The plausible limits of a payload of this cell's sensor."""
        sensor = self.force_torque
        return PayloadLimits(sensor.range_n, sensor.range_nm, self.gravity_base_m_s2, sensor.tilt_limit_rad)
