"""Recordings made by hand: what was said on a cell's bus, and when by the cell's clock."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from crosspih_common.bus.codec import encode
from crosspih_common.keys import Topic
from crosspih_common.messages import Image
from services.recorder.config import RecorderConfig
from services.recorder.file import RecordingFile, create_file
from services.recorder.sample import Sample

MS = 1_000_000
CELL = "cell1"
WALL_NS = 1_700_000_000_000 * MS


@dataclass(frozen=True, slots=True)
class Said:
    """One message, and the cell's time, ms."""

    topic: Topic[Any]
    value: Any
    at_ms: int


def recording_of(folder: Path, said: list[Said], cell_yaml: str = f"cell: {{name: {CELL}}}") -> Path:
    """The file; what was said first comes first."""
    path, stream = create_file(folder, "by-hand")
    file = RecordingFile(path, stream, RecorderConfig(), {"cell": {"name": CELL, "path": "c.yaml", "yaml": cell_yaml}})
    numbers: Counter[str] = Counter()
    for index, one in enumerate(said):
        key, stamp_ns = one.topic.key(CELL), one.at_ms * MS
        value, number = one.value, numbers[key]
        if isinstance(value, Image):
            value = replace(value, stamp_ns=stamp_ns, seq=number)
        else:
            value = value.model_copy(update={"stamp_ns": stamp_ns, "seq": number})
        sample = Sample(key, one.topic, encode(value), numbers[key], stamp_ns, WALL_NS + (stamp_ns + index * 1000))
        file.write(sample)
        numbers[key] += 1
    file.finish({})
    return path
