"""Finds the unfinished recording of a recorder process that ended while it was recording."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from crosspih_common.recording.parts import first_part, part_number
from crosspih_common.recording.records import Metadata
from crosspih_common.recording.scanning import Damage, scanning

HEAD_RECORDS = 16  # the metadata that is read here is among the first records of a file
SHUT_DOWN = "shut_down"  # the value of `why` for a recording whose recorder was stopped while it was recording
ASKED = "asked"


@dataclass(frozen=True, slots=True)
class BrokenOff:
    """A recording that nobody asked to end; `ago_s` is the time since its last part was written."""

    first: Path
    name: str
    last_part: int
    ago_s: float


def broken_off(directory: Path, cell: str, boot_id: str, within_s: float) -> BrokenOff | None:
    """The recording to go on with: the newest one of the cell's present run, if nobody asked for its end.

    None where there is none, or where it was last written more than `within_s` of wall time ago.
    """
    now_s = time.time()
    found = []
    try:
        for path in directory.glob("*.mcap"):
            ago_s = now_s - path.stat().st_mtime
            if ago_s <= within_s:
                found.append((ago_s, path))
    except OSError:
        return None
    for ago_s, path in sorted(found):
        words = _words(path, HEAD_RECORDS)
        told = words.get("recording", {})
        if told.get("boot_id") != boot_id or words.get("cell", {}).get("name") != cell:
            continue
        if _words(path, None).get("end", {}).get("why") == ASKED:
            return None
        first = first_part(path)
        return BrokenOff(first, told.get("name", first.stem), part_number(path), max(ago_s, 0.0))
    return None


def _words(path: Path, records: int | None) -> dict[str, dict[str, str]]:
    """The metadata among the first `records` records of a file; with None all of the file's metadata, and nothing if it
    is torn.
    """
    words: dict[str, dict[str, str]] = {}
    try:
        with scanning(path) as scan:
            if records is None and scan.summary is None:
                return {}
            for found in islice(scan, records):
                if not isinstance(found, Damage) and isinstance(found.content, Metadata):
                    words[found.content.name] = found.content.entries
    except OSError:
        return {}
    return words
