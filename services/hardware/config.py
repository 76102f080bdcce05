"""The hardware service's own settings: which driver serves the cell, and what the simulated one is like."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from crosspih_common.config.section import Section
from services.hardware.drivers.simulated.config import SimulatedConfig


class HardwareConfig(Section):
    """The `hardware` section of a cell's file."""

    driver: str = Field(
        default="simulated",
        description='a name in drivers/registry.py, or your own "package.module:function"',
    )
    engine: Literal["auto", "pybullet", "mujoco"] = Field(
        default="auto", description="of the simulated cell; auto: pybullet where it is installed, else mujoco"
    )
    options: dict[str, Any] = Field(default_factory=dict, description="for your own driver, as it likes")
    simulated: SimulatedConfig = SimulatedConfig()
