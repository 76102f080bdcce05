"""What of an ATI sensor stands in the cell's file: `hardware.ati`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from crosspih_common.config.section import Section


class AtiConfig(Section):
    """The box, and what it must be set to. Nothing is ever written to the box but start, stop and, if asked, bias."""

    host: str = Field(min_length=1, description="its address; 192.168.1.1 as it comes from the factory")
    rdt_port: int = Field(default=49152, ge=1, le=65535, description="UDP")
    http_port: int = Field(default=80, ge=1, le=65535, description="of its web pages")
    timeout_s: float = Field(default=2.0, gt=0.0, le=30.0, description="for the page and for the first record")
    calibration: str | None = Field(
        default=None, description="serial number of the calibration that must be in use, such as FT27462"
    )
    rate_hz: int | None = Field(default=None, ge=20, le=8000, description="the RDT output rate that it must be set to")
    bias: bool = Field(
        default=False, description="take what it feels when it is opened for zero; crosspih itself never needs that"
    )
    status_table: Literal["auto", "net_ft", "axia"] = Field(
        default="auto", description="how its status word is read; auto: by the product's name on its page"
    )
    internal_rate_hz: float | None = Field(
        default=None, gt=0.0, le=100_000.0, description="at which its F/T sequence counts, where the page does not say"
    )
    best_delay_s: float = Field(
        default=5e-4, gt=0.0, le=0.05, description="the network's: of the records of any second one is no later"
    )
