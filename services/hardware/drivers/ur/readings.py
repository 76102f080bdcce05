"""The wrist sensor's reading at the flange, of what the controller sends."""

from __future__ import annotations

from typing import Any

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import skew
from crosspih_common.geometry.pose import Array


def raw_reading(output: str, package: dict[str, Any], model: ArmModel, major: int, gravity_base_m_s2: Array) -> Array:
    """Force and moment (6,), N and Nm, in the flange's axes about its origin, bias and weight included.

    `ft_raw_wrench` is taken as it comes. `actual_TCP_force` is in the base's axes and without the payload's weight; it
    is about the flange on an e-Series and about the tool centre point on a CB3: turned, moved, and the weight of
    `payload` at `payload_cog` put back in.
    """
    if output == "ft_raw_wrench":
        return np.array(package[output])
    turn = model.pose_base_flange(np.array(package["actual_q"])).rotation
    wrench = np.array(package["actual_TCP_force"])
    force, moment = turn.T @ wrench[:3], turn.T @ wrench[3:]
    if major < 5:
        moment = moment + skew(np.array(package["tcp_offset"][:3])) @ force
    weight = turn.T @ (package["payload"] * np.asarray(gravity_base_m_s2, float))
    return np.concatenate([force + weight, moment + skew(np.array(package["payload_cog"])) @ weight])
