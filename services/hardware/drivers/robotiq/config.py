"""What of a Robotiq FT 300 stands in the cell's file: `hardware.robotiq`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from crosspih_common.config.section import Section


class RobotiqConfig(Section):
    """Where the sensor is: a serial port, or a Modbus TCP gateway before it."""

    serial: str | None = Field(default=None, description="/dev/ttyUSB0, or a name below /dev/serial/by-id")
    host: str | None = Field(default=None, description="of a Modbus TCP gateway")
    tcp_port: int = Field(default=502, ge=1, le=65535)
    device_id: int = Field(default=9, ge=1, le=247, description="its Modbus address")
    mode: Literal["auto", "stream", "poll"] = Field(
        default="auto",
        description="stream: 100 a second, on a serial port, which auto takes there; poll: registers",
    )
    poll_hz: float = Field(default=50.0, ge=20.0, le=500.0, description="how often registers are read in `poll`")
    timeout_s: float = Field(default=0.5, gt=0.0, le=10.0, description="for an answer")

    @model_validator(mode="after")
    def _one_place(self) -> RobotiqConfig:
        if (self.serial is None) == (self.host is None):
            raise ValueError("serial, host: give one of them, where the sensor is")
        if self.mode == "stream" and self.serial is None:
            raise ValueError("mode: stream is spoken on a serial port only; leave it out, or give serial")
        return self

    @property
    def streams(self) -> bool:
        """Whether the data stream is used."""
        return self.serial is not None and self.mode != "poll"
