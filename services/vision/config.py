"""The vision service's own settings."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section


class VisionConfig(Section):
    """The `vision` section of a cell's file."""

    image_deadline_s: float = Field(default=5.0, gt=0.0, description="wall time the two images of a pair may take")
    capture_deadline_s: float = Field(default=30.0, gt=0.0)
