"""The driver `ur`: opens the arm, and with it the sensor in its wrist."""

from __future__ import annotations

import numpy as np

from crosspih_common.errors import ConfigError, DeviceLost
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.ur.arm import UrArm, UrWrench
from services.hardware.drivers.ur.checks import known_payload_kg
from services.hardware.drivers.ur.config import UrConfig
from services.hardware.drivers.ur.link import Expected
from services.hardware.protocols import Devices

JOINTS = 6


def open_devices(request: OpenRequest) -> Devices:
    """The robot of `hardware.ur`. Raises ConfigError: no such section, no robot there, another robot, not ready."""
    config = request.config.ur
    if config is None:
        raise ConfigError("hardware.ur: is not in the cell's file; the driver `ur` wants at least its host")
    if "arm" not in request.wanted:
        raise ConfigError("hardware.drivers.force_torque: ur reads the sensor with its arm; name ur for the arm too")
    workcell = request.workcell
    model = workcell.arm()
    if len(model.fixed) != JOINTS + 1:
        raise ConfigError(f"cell.arm: {model.name} has {len(model.fixed) - 1} joints, and a Universal Robots arm six")
    _require_honest_delay(config, request.config.limits.sensor_delay_s)
    payload_kg = known_payload_kg(config.payload_kg, workcell.force_torque.weighed_n)
    wants_wrench = "force_torque" in request.wanted
    try:
        arm = UrArm(config, Expected(model, payload_kg, wants_wrench), np.asarray(workcell.gravity_base_m_s2, float))
    except DeviceLost as error:
        raise ConfigError(f"hardware.ur: {error.text}") from None
    return Devices(joints=arm, wrench=UrWrench(arm) if wants_wrench else None, realtime=True, close=arm.close)


def _require_honest_delay(config: UrConfig, delay_s: float) -> None:
    """The caps are reckoned from how late a motor hears of a force; servoj makes that at least its lookahead."""
    if delay_s < config.lookahead_s:
        raise ConfigError(
            f"hardware.limits.sensor_delay_s: {delay_s:g} s, and the arm follows its set-points "
            f"hardware.ur.lookahead_s = {config.lookahead_s:g} s late: say {config.lookahead_s + 0.005:g} at the "
            "least, or what may touch would be let go too fast for the cap"
        )
