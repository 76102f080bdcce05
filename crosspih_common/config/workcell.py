"""What every service of a cell knows beforehand: drawings, mounting, where the hole should be. No secrets of the
simulator are here: on a real cell these are the data sheet, the CAD drawing and a tape measure."""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from crosspih_common.arm import ArmModel, xb4
from crosspih_common.config.drawing import HoleDrawing, PegDrawing
from crosspih_common.config.section import Section
from crosspih_common.config.surroundings import Surroundings
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.base import Vector3, Vector6


class HolePrior(Section):
    """Where the hole is put, roughly: the nominal pose and how far it may be off, about the nominal hole's axes."""

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

    name: str = Field(default="cell1", pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$", description="the key prefix")
    peg: PegDrawing = PegDrawing()
    hole: HoleDrawing = HoleDrawing()
    hole_prior: HolePrior = HolePrior()
    surroundings: Surroundings = Surroundings()
    # from the flange to {K}, where the sensor measures; the tip is then 0.146 m past the flange
    flange_to_ft_m: float = Field(default=0.0663, gt=0.0)
    home_joints_rad: Vector6 = (-1.44, 0.98, 0.09, -1.35, -1.62, -0.07)
    # elasticity between the encoders and the links; about 100 N/mm at the tool in front of the hole
    joint_stiffness_nm_rad: Vector6 = (20000.0, 20000.0, 15000.0, 5000.0, 5000.0, 2500.0)
    gravity_base_m_s2: Vector3 = (0.0, 0.0, -9.81)
    # dry friction to expect between peg and hole; the estimator measures it from the touches
    friction_expected: float = Field(default=0.1, ge=0.0, le=1.0)
    # how deep the body must be in its bore to count as inserted
    insertion_depth_m: float = Field(default=0.015, gt=0.0)

    @model_validator(mode="after")
    def _hole_can_be_made(self) -> Workcell:
        self.hole.shape(self.peg.shape())
        return self

    def arm(self) -> ArmModel:
        """The arm's kinematics and limits."""
        return xb4()

    def pose_flange_peg(self) -> Pose:
        """The peg frame {J} = {K} in the flange frame."""
        return Pose.from_translation([0.0, 0.0, self.flange_to_ft_m])

    def pose_base_peg(self, joints_rad: Array | tuple[float, ...]) -> Pose:
        """Forward kinematics up to the peg frame."""
        return self.arm().pose_base_flange(joints_rad) @ self.pose_flange_peg()

    def compliance_peg(self, joints_rad: Array | tuple[float, ...]) -> Array:
        """(6, 6): the twist of the peg frame (x, y, z, rx, ry, rz, in the peg frame) a unit wrench on the peg makes.

        C = J K^-1 J^T with the Jacobian of the peg frame's origin (Salisbury 1980).
        """
        jacobian = self.arm().jacobian(joints_rad, self.pose_flange_peg())
        rotation = self.pose_base_peg(joints_rad).rotation
        to_peg = np.zeros((6, 6))
        to_peg[:3, :3] = rotation.T
        to_peg[3:, 3:] = rotation.T
        local = to_peg @ jacobian
        return np.asarray(local @ np.diag(1.0 / np.asarray(self.joint_stiffness_nm_rad)) @ local.T)
