"""The files of one recording: `x.mcap`, and `x.part2.mcap` and so on where the recorder had to begin again."""

from __future__ import annotations

import re
from pathlib import Path

_PART = re.compile(r"(?P<first>.+)\.part(?P<number>[1-9]\d*)\.mcap")


def part_path(first: Path, number: int) -> Path:
    """The path of a part; the first part has the recording's own name."""
    return first if number == 1 else first.with_name(f"{first.stem}.part{number}.mcap")


def part_number(path: Path) -> int:
    """The number of a file's part."""
    match = _PART.fullmatch(path.name)
    return int(match["number"]) if match else 1


def first_part(path: Path) -> Path:
    """The first part of the recording that a file belongs to."""
    match = _PART.fullmatch(path.name)
    return path.with_name(f"{match['first']}.mcap") if match else path


def parts_of(path: Path) -> list[Path]:
    """The files of a recording that is named by its first one, in order. A later part by itself is that part alone.

    Missing files are not listed; the reader of the first part notices a missing file by its name.
    """
    if first_part(path) != path:
        return [path]
    later = {}
    if path.parent.is_dir():
        for entry in path.parent.glob(f"{_escaped(path.stem)}.part*.mcap"):
            if (number := part_number(entry)) > 1 and first_part(entry) == path:
                later[number] = entry
    return [path, *(later[number] for number in sorted(later))]


def _escaped(text: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", text)
