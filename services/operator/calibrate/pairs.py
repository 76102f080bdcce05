"""Where the pairs of pictures of a calibration come from: earlier files, a recording, the arm, or a person."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from crosspih_common.config import CellFile
from crosspih_common.errors import ConfigError
from services.operator.assembly.stack import cell_session
from services.operator.calibrate.folder import Taken, new_folder, pair_job, read_taken
from services.operator.calibrate.options import needed, recorded, say_notes
from services.operator.calibrate.page import LivePage
from services.operator.calibrate.recorded import is_recording
from services.operator.calibrate.recorded_pictures import taken_of
from services.operator.calibrate.taking import VISION, ask, take_by_arm, take_by_hand
from services.operator.config import BoardSection, OperatorConfig
from services.operator.locate.worker import OfflineVision

NEEDED = ("hardware",)


@dataclass(frozen=True, slots=True)
class WantedPairs:
    """Which pairs a calibration wants: those of `files`, or else how new ones are taken.

    `poses`: each pair says how the arm stood, also where a person takes it.
    """

    pattern: str | None
    files: list[Path] | None
    pairs: int
    by_hand: bool
    poses: bool
    share: float
    speed: str | None
    page: bool
    record: bool


@dataclass(slots=True)
class Pairs:
    """What was taken: the folder that the pictures are in, that of what is found, and the vision process that has seen
    them."""

    taken: Taken
    pictures: Path
    own: Path
    vision: OfflineVision

    def jobs(self, gamma: str, with_joints: bool = False) -> list[dict[str, Any]]:
        """For the vision process; `with_joints`: those alone that say how the arm stood."""
        pairs = [pair for pair in self.taken.pairs if pair.joints_rad is not None or not with_joints]
        return [pair_job(pair, self.pictures, gamma) for pair in pairs]

    def ask(self, do: str, jobs: list[dict[str, Any]], **further: Any) -> dict[str, Any]:
        """What the vision process finds in `jobs`, and the board. Raises BadInput, VisionLost, CalibrationRefused."""
        found = ask(self.vision, {"do": do, "board": self.taken.board, "pairs": jobs, **further})
        return {**found, "board": self.taken.board}


@contextmanager
def taken_pairs(console: Console, what: str, cell: CellFile, wanted: WantedPairs) -> Iterator[Pairs]:
    """The pairs, in a new folder of the calibration `what`. Raises CrosspihError."""
    own = new_folder(cell.workcell.name, what)
    files = wanted.files
    with OfflineVision(VISION) as vision:
        if files and any(map(is_recording, files)):
            if len(files) > 1:
                raise ConfigError("--from: give one recording (.mcap), or pictures, and not both")
            taken, notes = taken_of(files[0], own, wanted.pattern, cell.workcell)
            say_notes(console, notes)
            yield Pairs(taken, own, own, vision)
            return
        if files:
            taken, pictures = read_taken(files, wanted.pattern)
            yield Pairs(taken, pictures, own, vision)
            return
        section = _board_of(cell, wanted.pattern)
        if section is None:
            raise ConfigError(
                "operator.board: the cell's file names no board; say operator: {board: {pattern: 9x6:0.02:0.015:"
                "DICT_4X4_50, pose_flange_board: {position_m: [...], rotvec_rad: [...]}}}, or --board and --by-hand"
            )
        with ExitStack() as stack:
            page = None
            if wanted.page:
                page = stack.enter_context(LivePage(own, f"crosspih calibrate {what}, {cell.workcell.name}"))
                console.print(f"live pictures: {page.address}", highlight=False)
            session, _ = stack.enter_context(cell_session(wanted.speed, needed(NEEDED, wanted.record)))
            with recorded(session, what, wanted.record, console):
                if wanted.by_hand:
                    taken = take_by_hand(session, vision, section.pattern, own, console, wanted.poses, _asked, page)
                else:
                    taken = take_by_arm(
                        session, vision, section, wanted.pairs, own, console, wanted.share, what, page=page
                    )
            if page is not None:
                page.say(f"{len(taken.pairs)} pairs are taken; reckoning")
            yield Pairs(taken, own, own, vision)


def _board_of(cell: CellFile, pattern: str | None) -> BoardSection | None:
    section = cell.section("operator", OperatorConfig).board
    if pattern is None:
        return section
    return BoardSection(pattern=pattern) if section is None else section.model_copy(update={"pattern": pattern})


def _asked(text: str) -> bool:
    print(text, file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    return bool(line) and not line.strip().lower().startswith("q")
