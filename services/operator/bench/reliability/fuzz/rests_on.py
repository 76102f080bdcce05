"""What a result of the fuzz bench rests on, and so the key under which it is kept: work on one service leaves the other
services' results, which take minutes each, as they are."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

from crosspih_common.keys import WALL_CLOCK, commands, topics
from crosspih_common.provenance import cell_identity, code_version, folder_version, result_key
from services.operator.assembly.session import NEEDED
from services.operator.bench.reliability.fuzz import attacking, decoding, payloads

IN_THE_CELL = frozenset([*NEEDED, "recorder"])


@cache
def drawn_by() -> str:
    """Sixteen hex digits over the code that draws the payloads: other payloads are other results."""
    return _read_by(payloads.__file__, decoding.__file__)


@cache
def _judged_by() -> str:
    return _read_by(attacking.__file__)


def _read_by(*files: str | None) -> str:
    return hashlib.sha256(b"".join(Path(str(file)).read_bytes() for file in files)).hexdigest()[:16]


def services_behind(part: str) -> frozenset[str]:
    """The services that affect the answers to a command's or topic's payloads: the command's server with those that it
    calls in turn, or the topic's readers. All of them for the assembly afterwards.
    """
    for command in commands():
        if command.path == part:
            return _asked_by(command.server)
    for topic in topics():
        if topic.path == part:
            return IN_THE_CELL & {*topic.readers}
    return IN_THE_CELL


def _asked_by(server: str) -> frozenset[str]:
    """A service, and all behind it. Requests for the time are left out: every service makes them, and nothing here
    depends on them.
    """
    found, new = {server}, {server}
    while new:
        new = {one.server for one in commands() if one is not WALL_CLOCK and new & {*one.callers}} - found
        found |= new
    return frozenset(found)


def part_key(part: str, count: int, seed: int, cell: dict[str, Any]) -> str:
    """The key under which the answers to `count` payloads of a part are stored, in a cell with this content."""
    folders = ("crosspih_common", *(f"services/{name}" for name in sorted(services_behind(part))))
    code = [code_version()] if part == attacking.AFTERWARDS else [folder_version(folder) for folder in folders]
    drawn = [drawn_by(), _judged_by()]
    return result_key(
        {
            "fuzz": "asked",
            "code": code,
            "drawn_by": drawn,
            "part": part,
            "count": count,
            "seed": seed,
            "cell": cell_identity(cell),
        }
    )
