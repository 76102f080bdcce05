"""The `operator` section of a cell's file: facts about the cell that only the operator's commands need."""

from __future__ import annotations

from pydantic import Field, field_validator

from crosspih_common.config.board import BoardPattern
from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section


class BoardSection(Section):
    """A ChArUco board on the flange, for `crosspih calibrate stereo` and `hand-eye`."""

    pattern: str = Field(description="as `crosspih calibrate board` wrote it: 7x5:0.018:0.013:DICT_4X4_50")
    pose_flange_board: Placement = Field(
        default=Placement(), description="about where it is, to a few mm and degrees: top left corner, z into the board"
    )

    @field_validator("pattern")
    @classmethod
    def _can_be_read(cls, pattern: str) -> str:
        return str(BoardPattern.of(pattern))


class OperatorConfig(Section):
    """All of it."""

    board: BoardSection | None = None
