"""A force/torque calibration made up for tests, and a forged one whose weight is far too small."""

from crosspih_common.messages import FtCalibration

CALIBRATION = FtCalibration(
    bias=(0.0,) * 6,
    weight_n=9.55,
    centroid_m=(0.0, 0.0, 0.04),
    gravity_base=(0.0, 0.0, -1.0),
    residual_force_n=0.01,
    residual_moment_nm=0.001,
    poses=6,
)
FORGED = CALIBRATION.model_copy(update={"weight_n": 0.5})
