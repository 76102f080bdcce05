"""The recorder's section of a cell's file."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from pydantic import Field

from crosspih_common.config import Section


class Compression(str, Enum):
    """How chunks are packed."""

    ZSTD = "zstd"
    LZ4 = "lz4"
    NONE = "none"


class RecorderConfig(Section):
    """Where recordings go, and how much data may be lost by a kill, a slow disk or a full one."""

    directory: Path = Field(default=Path("recordings"), description="made when missing")
    required: bool = Field(
        default=False, description="refuse an assembly that cannot be recorded, rather than do it and say so"
    )
    min_free_bytes: int = Field(default=32 << 20, ge=0, description="a disk with less free counts as full")
    retry_s: float = Field(default=1.0, gt=0.0, le=60.0, description="how often a disk that failed is tried again")
    resume_s: float = Field(
        default=60.0, ge=0.0, description="a recording that was broken off no longer ago goes on in a new part"
    )
    flush_s: float = Field(default=0.25, gt=0.0, le=10.0, description="what a kill -9 loses at most")
    chunk_bytes: int = Field(
        default=1 << 16, ge=1 << 12, description="a chunk is also closed when it holds this much: what damage costs"
    )
    compression: Compression = Compression.ZSTD
    foxglove: bool = Field(
        default=True, description="write topics for viewers beside what was said: frames, scene, wrenches, log"
    )
    foxglove_hz: float = Field(default=50.0, gt=0.0, le=500.0, description="of the frames and joints in them")
    # the most that may wait for the disk; beyond it samples are dropped and counted
    queue_samples: int = Field(default=50_000, ge=1)
    queue_bytes: int = Field(default=256 << 20, ge=1 << 20, description="of samples above 4 KiB: pictures")
    # at a stop: wait until no earlier sample has arrived for `quiet_s`, but at most `quiet_limit_s`
    quiet_s: float = Field(default=0.2, ge=0.0, le=5.0)
    quiet_limit_s: float = Field(default=2.0, ge=0.0, le=30.0)
