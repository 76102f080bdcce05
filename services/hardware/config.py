"""The hardware service's own settings: which driver serves which device, and the limits that hold for all of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from crosspih_common.config import CellFile
from crosspih_common.config.section import Section
from services.hardware.control.config import LimitsConfig
from services.hardware.drivers.ati.config import AtiConfig
from services.hardware.drivers.genicam.config import GenicamConfig
from services.hardware.drivers.pictures.config import PicturesConfig
from services.hardware.drivers.recorded.config import RecordedConfig
from services.hardware.drivers.robotiq.config import RobotiqConfig
from services.hardware.drivers.ros2.config import Ros2Config
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.ur.config import UrConfig
from services.hardware.drivers.video.config import VideoConfig

DEVICES: tuple[Literal["arm", "force_torque", "camera"], ...] = ("arm", "force_torque", "camera")


class DriversConfig(Section):
    """Another driver for one device; the others keep `hardware.driver`."""

    arm: str | None = None
    force_torque: str | None = None
    camera: str | None = None


class HardwareConfig(Section):
    """The `hardware` section of a cell's file."""

    driver: str = Field(
        default="simulated", description='a name in drivers/registry.py, or your own "package.module:function"'
    )
    drivers: DriversConfig = DriversConfig()
    devices: tuple[Literal["arm", "force_torque", "camera"], ...] = Field(
        default=DEVICES, description="what `python -m services.hardware` hosts; the rest is for other processes"
    )
    engine: Literal["auto", "pybullet", "mujoco"] = Field(
        default="auto", description="of the simulated cell; auto: pybullet where it is installed, else mujoco"
    )
    options: dict[str, Any] = Field(default_factory=dict, description="for your own driver, as it likes")
    limits: LimitsConfig = LimitsConfig()
    simulated: SimulatedConfig = SimulatedConfig()
    recorded: RecordedConfig = RecordedConfig()
    pictures: PicturesConfig = PicturesConfig()
    ati: AtiConfig | None = None
    robotiq: RobotiqConfig | None = None
    ur: UrConfig | None = None
    genicam: GenicamConfig | None = None
    video: VideoConfig | None = None
    ros2: Ros2Config | None = None

    def driver_of(self, device: str) -> str:
        """The driver of one of `DEVICES`."""
        chosen: str | None = getattr(self.drivers, device)
        return chosen or self.driver


def with_calibration_beside(config: HardwareConfig, cell: Path) -> HardwareConfig:
    """The section; a calibration of cameras that it names is looked for beside the cell's file first."""
    for name in ("genicam", "video", "pictures"):
        section = getattr(config, name)
        named = None if section is None else section.calibration
        if named is not None and (beside := cell.resolve().parent / named).is_file():
            found = section.model_copy(update={"calibration": beside})
            config = config.model_copy(update={name: found})
    return config


def hardware_of(cell: CellFile) -> HardwareConfig:
    """The section of a cell's file, its cameras' calibration beside it. Raises ConfigError."""
    return with_calibration_beside(cell.section("hardware", HardwareConfig), Path(cell.path))
