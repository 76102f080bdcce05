"""What the simulated cell is like: its sensor, its cameras, and where it differs from what the services are told."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from crosspih_common.config.board import BoardPattern
from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section
from crosspih_common.messages.base import Joints, Vector3, Vector6

Positive = Annotated[float, Field(gt=0.0)]


class SimulatedSensorConfig(Section):
    """What the simulated F/T sensor adds to the truth. The services must find bias and payload by calibration."""

    # of the size of the paper's own F0 (its Eq. 16)
    bias: Vector6 = (0.1714, -0.0426, -0.0153, -0.0020, 0.0138, -0.0067)
    noise_n: float = Field(default=0.1, ge=0.0, description="standard deviation of one 1 kHz sample, each axis")
    noise_nm: float = Field(default=0.005, ge=0.0)
    bandwidth_hz: float = Field(
        default=150.0, ge=10.0, le=500.0, description="of the sensor's own first-order low-pass"
    )
    drift_n_s: float = Field(default=0.0, ge=-1.0, le=1.0, description="of each force axis, since the last reset")
    # what hangs behind the sensor, peg included: 9.555 N, where the paper's Eq. 15 puts it
    payload_kg: float = Field(default=0.974, gt=0.05, le=4.0)
    payload_centroid_m: Vector3 = (0.0006, 0.0011, 0.0327)


Finish = Literal["matt", "milled", "ground", "turned", "cast", "blasted"]
Background = Literal["dark", "grey", "bright", "cluttered"]


class AppearanceConfig(Section):
    """What the plate and what is around it look like. Each is drawn by the seed of a trial where it is left out."""

    finish: Finish | None = Field(
        default=None,
        description="of the face: matt, milled (lines across), ground (fine lines one way), turned (rings), cast or "
        "blasted (coarse or fine speckle)",
    )
    finish_strength: float | None = Field(
        default=None, ge=0.0, le=0.4, description="one standard deviation of the finish, a share of the face's grey"
    )
    shine: float | None = Field(
        default=None, ge=0.0, le=1.0,
        description="how much of the light comes back as from metal: by where light and camera stand, so that the two "
        "pictures differ; 0: as from paint",
    )  # fmt: skip
    face_gradient: float | None = Field(
        default=None, ge=0.0, le=1.0, description="how much the light changes from one side of the face to the other"
    )
    picture_gradient: float | None = Field(
        default=None, ge=0.0, le=1.0, description="how much the light changes from one edge of the picture to the other"
    )
    edge_glints: float | None = Field(
        default=None, ge=0.0, le=500.0, description="grey levels of the bright stretches along broken edges of the rim"
    )
    face_glints: int | None = Field(default=None, ge=0, le=50, description="bright spots on the face")
    background: Background | None = Field(default=None, description="what is behind the plate")
    hole: Literal["through", "blind"] | None = Field(
        default=None, description="through: the background is seen in it; blind: a bottom is"
    )
    bottom_depth_m: float | None = Field(
        default=None, gt=0.0, le=1.0,
        description="of a blind hole, below the face; drawn: nearly as deep as the plate is thick",
    )  # fmt: skip

    @model_validator(mode="after")
    def _only_a_blind_hole_has_a_bottom(self) -> AppearanceConfig:
        if self.bottom_depth_m is not None and self.hole != "blind":
            raise ValueError("bottom_depth_m: only a blind hole has a bottom; say hole: blind, or leave it out")
        return self


class CameraConfig(Section):
    """How the simulated cameras turn light into pixels, and what they see. The lenses are in `cell.camera`."""

    exposure_s: float = Field(default=0.02, gt=0.0, le=1.0, description="the cell's clock advances by this a capture")
    samples: int = Field(default=4, ge=1, le=8, description="sub-pixels a side")
    blur_px: float | None = Field(
        default=None, ge=0.0, le=5.0,
        description="Gaussian, before the pixel's own square; left out: each lens's own, drawn by the seed",
    )  # fmt: skip
    noise_grey: float | None = Field(
        default=None, ge=0.0, le=50.0, description="one standard deviation, of 255; left out: drawn by the seed"
    )
    brightness: float = Field(default=1.0, ge=0.0, le=4.0, description="of the cell's light; 0.3 is a dim cell")
    glare: float = Field(
        default=0.0, ge=0.0, le=500.0, description="grey levels of a round reflection near the rim under lamp 0"
    )
    appearance: AppearanceConfig = AppearanceConfig()


class TruthConfig(Section):
    """How the simulated cell differs from its drawing and its calibrations; the services are not told."""

    taper_slope_factor: float = Field(default=1.0, gt=0.8, lt=1.25, description="of the taper, whose ends stay")
    clearance_offset_m: float = Field(default=0.0, gt=-0.002, lt=0.002, description="added to the hole's clearance")
    ft_shift_m: Vector3 = Field(default=(0.0, 0.0, 0.0), description="of the sensor's origin, in the peg frame")
    ft_turn_rad: Vector3 = Field(default=(0.0, 0.0, 0.0), description="of the sensor's axes, a rotation vector")
    ft_factors: Vector6 = Field(
        default=(1.0,) * 6, description="of the six numbers that the sensor says: -1 for a reversed sign, 1000 for mN"
    )
    camera_shift_m: Vector3 = Field(default=(0.0, 0.0, 0.0), description="of the left camera, in its own frame")
    camera_turn_rad: Vector3 = Field(default=(0.0, 0.0, 0.0), description="of the left camera, in its own frame")
    joint_stiffness_factor: float = Field(default=1.0, gt=0.05, lt=20.0)
    joint_stiffness_factors: Joints | None = Field(default=None, description="of each joint, on top of the one of all")
    peg_shift_m: Vector3 = Field(default=(0.0, 0.0, 0.0), description="of the peg in its holder, in the peg frame")
    right_shift_m: Vector3 = Field(default=(0.0, 0.0, 0.0), description="of the right camera, in its own frame")
    right_turn_rad: Vector3 = Field(default=(0.0, 0.0, 0.0), description="of the right camera, in its own frame")

    @field_validator("joint_stiffness_factors")
    @classmethod
    def _of_springs(cls, factors: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if factors is not None and not all(0.05 < factor < 20.0 for factor in factors):
            raise ValueError("wants a factor of 0.05 to 20 for each joint")
        return factors


class BoardConfig(Section):
    """A ChArUco board that is clamped to the flange; the pictures show it, and nothing can touch it."""

    pattern: str = Field(default="7x5:0.015:0.011:DICT_4X4_50", description="as `crosspih calibrate board` writes it")
    pose_flange_board: Placement = Field(default=Placement(), description="where it really is: top left, z into it")
    margin_m: float = Field(default=0.006, ge=0.0, le=0.1, description="white around the squares")

    @field_validator("pattern")
    @classmethod
    def _can_be_read(cls, pattern: str) -> str:
        return str(BoardPattern.of(pattern))


class SimulatedConfig(Section):
    """The simulated cell."""

    seed: int = Field(default=0, ge=0, description="of the first trial, until a reset names another")
    speed: Literal["realtime", "max"] = Field(
        default="realtime", description="max: the cell's clock runs only while a command does"
    )
    friction_coefficient: float = Field(default=0.1, ge=0.0, le=1.0, description="peg against hole")
    contact_stiffness_n_m: float | None = Field(
        default=None, ge=1e4, le=1e6,
        description="of every contact point, along its normal; points side by side add up. None: rigid",
    )  # fmt: skip
    # how hard the simulated peg lands, by `crosspih bench caps`: PyBullet takes a blow up within its step
    landing_mass_kg: Positive = 7.3
    landing_stiffness_n_m: Positive = 7.3e6
    # of each joint against its own critical damping; see engines/protocol.py for what it costs and buys
    joint_damping_ratio: float = Field(default=0.5, gt=0.0, le=1.5)
    period_s: float = Field(default=0.001, ge=0.001, le=0.02, description="of the arm's cycle, in whole milliseconds")
    delay_s: float = Field(default=0.0, ge=0.0, le=0.05, description="how late a sample of the sensor is heard")
    watch_contact: bool = Field(default=False, description="look at the true contact force in every step; slower")
    # what the links weigh; engines/arm_bodies.py has what is taken when these are left out
    link_masses_kg: tuple[Positive, ...] | None = Field(default=None, description="of each link, from the base")
    joint_inertias_kg_m2: tuple[Positive, ...] | None = Field(
        default=None, description="of motor and gear of each joint, about its own axis, seen through the gear"
    )
    force_torque: SimulatedSensorConfig = SimulatedSensorConfig()
    camera: CameraConfig = CameraConfig()
    truth: TruthConfig = TruthConfig()
    board: BoardConfig | None = Field(default=None, description="for `crosspih calibrate stereo` and `hand-eye`")
