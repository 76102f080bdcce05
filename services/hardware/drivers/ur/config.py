"""`hardware.ur` of a cell's file."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from crosspih_common.config.section import Section


class UrConfig(Section):
    """The robot's address, how it follows, and what is held to on connecting."""

    host: str = Field(description="the controller's address: its pendant shows it under Settings, System, Network")
    wrench: Literal["ft_raw_wrench", "actual_TCP_force"] = Field(
        default="ft_raw_wrench",
        description="of which output the wrist sensor's readings are made; the latter below PolyScope 5.9, with the "
        "payload's weight put back in",
    )
    lookahead_s: float = Field(
        default=0.03, ge=0.03, le=0.2, description="servoj's lookahead_time: the arm follows so late"
    )
    gain: float = Field(default=2000.0, ge=100.0, le=2000.0, description="servoj's gain: how stiffly it follows")
    silence_s: float = Field(
        default=0.1,
        ge=0.02,
        le=1.0,
        description="without a set-point for so long the robot's program stops it; without a package it counts as lost",
    )
    payload_kg: float | None = Field(
        default=None, ge=0.0, le=50.0,
        description="what hangs on the flange; left out, that of cell.force_torque.weighed_n, else it is not compared",
    )  # fmt: skip
    payload_tolerance_kg: float = Field(default=0.2, gt=0.0, le=5.0)
    flange_tolerance_m: float = Field(
        default=0.005, gt=0.0, le=0.05,
        description="between the flange as the controller says it and as cell.arm reckons it from the same joints",
    )  # fmt: skip
    start_tolerance_rad: float = Field(
        default=0.01, gt=0.0, le=0.1, description="of the first set-point after connecting, from where a joint stands"
    )
