"""What is played back, from where, and how."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from crosspih_common.config.section import Section


class RecordedConfig(Section):
    """The recording that the driver `recorded` plays."""

    file: Path | None = Field(default=None, description="an MCAP file of crosspih's recorder, from where it is started")
    from_s: float = Field(default=0.0, ge=0.0, description="begin so long after the recording's first instant")
    speed: float = Field(default=1.0, gt=0.0, le=100.0, description="times the wall's clock, in real time")
    period_s: float | None = Field(
        default=None, ge=0.001, le=0.02,
        description="of the arm's cycle; None: as the joint states were recorded. A shorter one interpolates them",
    )  # fmt: skip
    tolerance_rad: float = Field(
        default=0.001, gt=0.0, le=0.5, description="of a joint, from where it is told to go to where it was then"
    )
    picture_wait_s: float = Field(
        default=5.0, ge=0.0, le=60.0, description="of the cell's clock, for the next recorded picture, in real time"
    )
    torn: bool = Field(default=False, description="true: play what is whole of a recording that was torn off")
