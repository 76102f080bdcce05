"""The stereo camera: what it is, and a pair of pictures."""

from __future__ import annotations

from enum import Enum
from typing import Any

from pydantic import Field, model_validator

from crosspih_common.messages.base import Frame, Message, Part, PoseData

MAX_PLUMB_BOB, FISHEYE_COUNT = 8, 4
# the fields of one camera, as they stood in the message when both cameras were equal and parallel
FLAT_FIELDS = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
EQUAL_FIELDS = (*FLAT_FIELDS, "baseline_m")


class DistortionModel(str, Enum):
    """How the lens bends: as OpenCV and ROS write it."""

    NONE = "none"
    PLUMB_BOB = "plumb_bob"  # k1, k2, p1, p2, k3, k4, k5, k6: the rest are 0
    FISHEYE = "fisheye"  # k1, k2, k3, k4 of the angle (Kannala and Brandt 2006)


class Gamma(str, Enum):
    """How a pixel's number stands to the light on it."""

    LINEAR = "linear"  # twice the light, twice the number: machine cameras
    SRGB = "srgb"  # IEC 61966-2-1: photos, JPEG


class CameraModel(Part):
    """One camera: pixel (u, v) = (fx x'/z + cx, fy y'/z + cy), integers at pixel centres, (x', y') bent by the lens.

    `distortion` of `plumb_bob` holds up to 8 numbers in OpenCV's order (k1, k2, p1, p2, k3, k4, k5, k6; those that are
    left out are 0), of `fisheye` 4, of `none` none.
    """

    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    fx_px: float = Field(gt=0.0)
    fy_px: float = Field(gt=0.0)
    cx_px: float
    cy_px: float
    distortion_model: DistortionModel = DistortionModel.NONE
    distortion: tuple[float, ...] = ()
    gamma: Gamma = Gamma.LINEAR

    @model_validator(mode="after")
    def _as_many_as_the_model_has(self) -> CameraModel:
        count, model = len(self.distortion), self.distortion_model
        if model is DistortionModel.NONE and any(self.distortion):
            raise ValueError("distortion has numbers and distortion_model is none; say plumb_bob or fisheye")
        if model is DistortionModel.PLUMB_BOB and count > MAX_PLUMB_BOB:
            raise ValueError(f"distortion of plumb_bob has {count} numbers; give at most {MAX_PLUMB_BOB}")
        if model is DistortionModel.FISHEYE and count != FISHEYE_COUNT:
            raise ValueError(f"distortion of fisheye has {count} numbers; give {FISHEYE_COUNT}")
        return self


class CameraCalibration(Message):
    """The two cameras, each with its own lens and size, where the right one stands and where the left one does.

    z looks ahead, x right, y down. The cameras need be neither equal nor parallel. The form of before (one camera's
    numbers and `baseline_m` of two equal parallel cameras without distortion) is still read.
    """

    frame: Frame = Frame.BASE
    left: CameraModel
    right: CameraModel
    pose_left_right: PoseData = Field(description="the right camera in the left one's frame")
    pose_base_camera: PoseData = Field(description="the left camera in the base frame")

    @model_validator(mode="before")
    @classmethod
    def _of_two_equal_parallel_cameras(cls, given: Any) -> Any:
        """What recordings and drivers of before say: (u, v) = (fx x/z + cx, fy y/z + cy), the right one along +x."""
        if not isinstance(given, dict) or "left" in given or not all(name in given for name in EQUAL_FIELDS):
            return given
        camera = {name: given[name] for name in FLAT_FIELDS}
        baseline_m = given["baseline_m"]
        if not isinstance(baseline_m, int | float) or not baseline_m > 0.0:
            raise ValueError(f"baseline_m is {baseline_m}; give the distance of the cameras, m, above 0")
        return {
            **{name: value for name, value in given.items() if name not in EQUAL_FIELDS},
            "left": camera,
            "right": camera,
            "pose_left_right": {"position_m": (baseline_m, 0.0, 0.0), "quaternion_xyzw": (0.0, 0.0, 0.0, 1.0)},
        }


class CaptureStereo(Message):
    """Take a pair now. The two images come on their own keys, stamped like the reply.

    Another light is for a picture that was refused: a driver that cannot change it may ignore both fields.
    """

    exposure_scale: float = Field(default=1.0, gt=0.0, le=64.0, description="factor on the camera's usual exposure")
    lamp: int = Field(default=0, ge=0, le=7, description="which of the cell's lamps is lit; 0 is the usual one")


class StereoPair(Message):
    """The pair that was taken: the images carry this `stamp_ns` on camera/left/image and camera/right/image."""

    frame: Frame = Frame.CAMERA_LEFT
    capture_id: int
    calibration: CameraCalibration
    exposure_s: float
