"""How a force/torque sensor's numbers become the contact wrench on the peg: one way for all services."""

from crosspih_common.wrench.averaging import mean_and_sd
from crosspih_common.wrench.low_pass import LowPass
from crosspih_common.wrench.mounting import SensorMounting
from crosspih_common.wrench.payload import Payload
from crosspih_common.wrench.plausibility import IMPLAUSIBLE, PayloadLimits, judge_bounds, judge_payload
from crosspih_common.wrench.sensed import refuse_implausible_wrench

__all__ = [
    "IMPLAUSIBLE",
    "LowPass",
    "Payload",
    "PayloadLimits",
    "SensorMounting",
    "judge_bounds",
    "judge_payload",
    "mean_and_sd",
    "refuse_implausible_wrench",
]
