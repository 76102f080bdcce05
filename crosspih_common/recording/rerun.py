"""The outcome of processing a recording again with a service's core: counts and differences."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crosspih_common.config import CellFile, load_cell
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import CLOCK, Topic
from crosspih_common.messages import Message
from crosspih_common.recording.comparing import FieldDifference, differences
from crosspih_common.recording.reader import Recording, read_recording


def begun_ns(recording: Recording) -> int:
    """The cell's time at which the recording began."""
    ticks = [sample.stamp_ns for key in recording.keys_of(CLOCK) for sample in recording.samples[key]]
    return ticks[0] if ticks else recording.span_ns()[0]


@dataclass(slots=True)
class Rerun:
    """The outcome so far. `parts` are [equal, all] counts of each compared part; `rows` the differences, in order."""

    start_ns: int
    parts: dict[str, list[int]] = field(default_factory=dict)
    rows: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def at_s(self, stamp_ns: int) -> float:
        """The time since the recording began, s."""
        return (stamp_ns - self.start_ns) * 1e-9

    def compare(
        self, part: str, what: str, at_ns: int, then: Message, now: Message, but: frozenset[str] = frozenset()
    ) -> bool:
        """Compare and count one pair; True if both are equal, except the fields of the moment and those in `but`."""
        found = differences(then, now, but)
        self.count(part, not found)
        for row in found:
            self.differ(what, at_ns, row)
        return not found

    def count(self, part: str, equal: bool) -> None:
        """Count one of a part."""
        counts = self.parts.setdefault(part, [0, 0])
        counts[0] += equal
        counts[1] += 1

    def differ(self, what: str, at_ns: int, row: FieldDifference) -> None:
        """Note something that differs."""
        self.rows.append({"at_s": self.at_s(at_ns), "asked": what, **row.as_json()})

    def as_json(self) -> dict[str, Any]:
        """The outcome as JSON, for the process that started this one."""
        return {"parts": self.parts, "differences": self.rows, "notes": self.notes}


Again = Callable[[Recording, CellFile, int, Rerun], None]


def run_again(topics: Iterable[Topic[Any]], rerun: Again, argv: list[str] | None = None) -> int:
    """The body of a `python -m services.X.again FILE --cell CELL [--from S]`: prints the outcome as JSON.

    `rerun(recording, cell, from_ns, outcome)`. Status 2 where the file or the cell cannot be read.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--cell", type=Path, required=True)
    parser.add_argument("--from", dest="from_s", type=float, default=0.0)
    asked = parser.parse_args(argv)
    try:
        recording = read_recording(asked.file, {CLOCK, *topics})
        outcome = Rerun(begun_ns(recording))
        with contextlib.redirect_stdout(sys.stderr):
            rerun(recording, load_cell(asked.cell), outcome.start_ns + round(asked.from_s * 1e9), outcome)
    except CrosspihError as error:
        print(error, file=sys.stderr)
        return 2
    json.dump(outcome.as_json(), sys.stdout)
    return 0
