"""The viewer's section of a cell's file."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config import Section


class ViewerConfig(Section):
    """Where the page is served, and how often it is updated."""

    host: str = Field(
        default="127.0.0.1",
        min_length=1,
        description="the address to listen on; with any but this machine's own the page needs a token",
    )
    port: int | None = Field(default=None, ge=1, le=65535, description="8080, or the next free one, where not given")
    scene_hz: float = Field(default=20.0, gt=0.0, le=60.0, description="how often the arm on the page moves")
    chart_hz: float = Field(default=3.0, gt=0.0, le=20.0, description="how often its charts and tables change")
    commands: bool = Field(default=True, description="whether the page may ask for an assembly; else it only shows")
