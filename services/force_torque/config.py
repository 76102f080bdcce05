"""The force_torque service's own settings."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section
from crosspih_common.messages import ContactClassifier


class ForceTorqueConfig(Section):
    """The `force_torque` section of a cell's file."""

    calibration_file: str = Field(
        default="run/{cell}/ft-calibration.yaml", description="where the calibration is kept; {cell} is the cell's name"
    )
    filter_hz: float = Field(default=50.0, gt=0.0, le=500.0, description="low-pass of the published contact wrench")
    onset_force_n: float = Field(default=1.0, gt=0.0)
    onset_moment_nm: float = Field(default=0.06, gt=0.0)
    onset_hold_s: float = Field(default=0.005, gt=0.0, lt=1.0, description="how long a contact must last to be one")
    free_air_mean_s: float = Field(default=0.5, gt=0.0, description="the mean in free air forgets over this")
    free_air_settle_s: float = Field(default=0.2, ge=0.0, description="left out of that mean after a contact")
    drift_force_n: float = Field(default=0.3, gt=0.0, description="mean |F| in free air that means: calibrate again")
    drift_moment_nm: float = Field(default=0.015, gt=0.0)
    still_rad_s2: float = Field(
        default=0.8, gt=0.0, description="joints that accelerate more make the payload's inertia look like contact"
    )
    gravity_free: bool = Field(default=True, description="find the direction of gravity too: the base may be tilted")
    residual_force_limit_n: float = Field(default=0.5, gt=0.0)
    residual_moment_limit_nm: float = Field(default=0.05, gt=0.0)
    least_weight_n: float = Field(default=0.2, gt=0.0, description="less than this on the sensor is nothing")
    turn_limit_rad: float = Field(
        default=0.087, gt=0.0, le=0.5, description="a sensor found turned by more against cell.force_torque is refused"
    )
    contact_classifier: ContactClassifier = Field(
        default=ContactClassifier.LIKELIHOOD,
        description="of touches: likelihood (mechanics, a cross only) or rule (the paper's); the stream is by the rule",
    )
    state_every_s: float = Field(default=0.1, gt=0.0, description="how often the contact state is judged")
