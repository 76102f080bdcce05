"""`crosspih bench day`: docs/hardware/in-a-day.md, walked by its own words before devices that only speak protocols.

The page's commands are run as they stand there, each a process; what it says to add to the cell's file is added. What a
person does beside is done here: the board is held, clamped and put away, Enter is pressed.
"""

from __future__ import annotations

import glob
import os
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.table import Table

import deploy
from crosspih_common.config import load_cell
from crosspih_common.errors import CrosspihError, NoService
from crosspih_common.geometry import Pose
from crosspih_common.keys import ASSEMBLE
from crosspih_common.modules import module_command
from crosspih_common.plain_yaml import text_of_file, yaml_of
from crosspih_common.recording.reader import read_recording
from services.operator.bench.cells.conditions import merged
from services.operator.bench.protocols.board import put_board
from services.operator.bench.protocols.hidden import cameras_of
from services.operator.bench.protocols.page import PageStep
from services.operator.bench.protocols.plants import HERE, Plant
from services.operator.bench.protocols.scoring_day import DayFigure, camera_rows, tool_rows
from services.operator.locate.calibration_file import FileReading, read_calibration
from services.operator.scoring.score import TrialFigures, score, seen_in_words

ROOT = Path(deploy.__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "hardware" / "in-a-day.md"
BEFORE = "as-begun.yaml"
PAIRS_BY_HAND, DEFAULTS = 20, 40
LEFT_OUT = {  # with the reason
    ("crosspih", "calibrate", "refine"): "wants some ten assemblies",
    ("crosspih", "bench", "assembly"): "wants an hour",
}
BOARD = {("calibrate", "stereo"): "hand", ("calibrate", "hand-eye"): "flange"}
LINES, TRIES = 3, 3
MAY_FAIL = ("cell", "doctor", "assemble")  # the walk continues, but its status is 1


def why_left_out(words: tuple[str, ...]) -> str:
    """Why a command of the page is not run; empty where it is."""
    if words[0] != "crosspih":
        return "of the machine, not of the cell"
    return next((why for beginning, why in LEFT_OUT.items() if words[: len(beginning)] == beginning), "")


def runs(step: PageStep) -> bool:
    """Whether a step is a command that is run: lines for a file, and steps that are left out, take no time."""
    return step.kind == "command" and not why_left_out(step.words)


@dataclass(slots=True)
class Walked:
    """A step and how it ended; `status` None: it was left out."""

    section: int
    text: str
    status: int | None
    wall_s: float
    said: str


@dataclass(slots=True, eq=False)
class Walk:
    """One walk: its folder, the current cell's file, the steps done."""

    plant: Plant
    folder: Path
    console: Console
    environment: dict[str, str] = field(default_factory=dict)
    done: list[Walked] = field(default_factory=list)
    assemblies: list[TrialFigures] = field(default_factory=list)

    @property
    def cell(self) -> Path:
        """The current cell's file."""
        return self.folder / self.environment.get("CROSSPIH_CELL", "lab.yaml")

    def take(self, step: PageStep) -> None:
        """Do one step."""
        began_s = time.monotonic()
        if step.kind == "export":
            self.environment[step.words[0]] = step.words[1]
            return
        status: int | None = 0
        said = ""
        if step.kind == "file":
            assert step.lines is not None
            self.add(step.lines)
        else:
            status, said = self.command(step.words)
            again = TRIES if step.words[1:2] == ("calibrate",) else 1
            while status and (again := again - 1):  # try again as a person would: the machine may have been busy
                self.told(step, status, time.monotonic() - began_s, said)
                began_s = time.monotonic()
                status, said = self.command(step.words)
        self.told(step, status, time.monotonic() - began_s, said)
        if status and step.words[1] not in MAY_FAIL:
            raise CrosspihError(f"section {step.section}: `{step.text}` failed; the page says not to go on")

    def told(self, step: PageStep, status: int | None, wall_s: float, said: str) -> None:
        """Keep and print how the step ended."""
        self.done.append(Walked(step.section, step.text, status, wall_s, said))
        verdict = "left out" if status is None else "done" if status == 0 else f"status {status}"
        colour = "yellow" if status is None else "green" if status == 0 else "red"
        self.console.print(f"{step.section}. {step.text}", highlight=False, markup=False, soft_wrap=True)
        self.console.print(f"   {verdict}, {self.done[-1].wall_s:.0f} s", style=colour, highlight=False)
        for line in said.splitlines():
            self.console.print(f"   {line}", style="dim", highlight=False, markup=False, soft_wrap=True)

    def add(self, lines: dict[str, Any]) -> None:
        """Add lines to the cell's file, as a person does in an editor."""
        content = merged(yaml_of(text_of_file(self.cell)), lines)
        self.cell.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")

    def command(self, words: tuple[str, ...]) -> tuple[int | None, str]:
        """Its status and its last words."""
        if why := why_left_out(words):
            return None, why
        where = next((where for name, where in BOARD.items() if words[1:3] == name), None)
        if where is not None and not put_board(where):
            raise NoService("the cameras' other end does not answer")
        typed = "\n" * DEFAULTS if words[1:3] == ("cell", "init") else ""
        if "--by-hand" in words:
            typed = "\n" * PAIRS_BY_HAND + "q\n"
        status, said = self.run(words[1:], typed)
        if where is not None:
            put_board("away")
        if words[1:3] == ("cell", "init") and status == 0:
            self.environment["CROSSPIH_CELL"] = words[3]
            self.add({"hardware": HERE, "recorder": {"directory": str(self.folder / "recordings")}})
        if words[1] == "assemble":
            self.judge()
        return status, said

    def run(self, words: tuple[str, ...], typed: str = "") -> tuple[int, str]:
        """`crosspih WORDS` in the folder, its output kept."""
        expanded = [one for word in words for one in self.expanded(word)]
        logs = self.folder / "logs"
        logs.mkdir(exist_ok=True)
        log = logs / f"{len(self.done):02d}-{'-'.join(words[:2])}.txt"
        path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        kept = {name: value for name, value in os.environ.items() if not name.startswith("CROSSPIH_")}
        environment = {**kept, "PYTHONPATH": path, "CROSSPIH_RUN_DIR": "run", "COLUMNS": "150", **self.environment}
        with log.open("w", encoding="utf-8") as output:
            child = subprocess.run(
                module_command("services.operator", *expanded), cwd=self.folder, env=environment, text=True,
                input=typed, stdout=output, stderr=subprocess.STDOUT, check=False,
            )  # fmt: skip
        text = log.read_text(encoding="utf-8")
        return child.returncode, "\n".join(line for line in text.splitlines()[-LINES:] if line.strip())

    def expanded(self, word: str) -> list[str]:
        """Expand variables as a shell does."""
        if "*" not in word:
            return [word]
        found = sorted(glob.glob(word, root_dir=self.folder))
        return found or [word]

    def judge(self) -> None:
        """Score the assembly of the newest recording against the truth."""
        newest = max((self.folder / "recordings").glob("*.mcap"), key=lambda file: file.stat().st_mtime, default=None)
        result = None if newest is None else read_recording(newest, [ASSEMBLE.reply_echo]).last(ASSEMBLE.reply_echo)
        if result is not None:
            workcell = load_cell(self.cell).workcell
            figures = score(workcell, result, self.plant.truth(), wall_s=0.0, recording=str(newest))
            self.assemblies.append(figures)

    def found(self) -> list[DayFigure]:
        """The results of the calibrations so far."""
        begun = load_cell(self.folder / BEFORE).workcell
        before, rows = cameras_of(begun.camera), []
        after = next((self.folder / name for name in ("cameras.yaml", "lenses.yaml") if (self.folder / name).exists()),
                     None)  # fmt: skip
        if after is not None:
            reading = FileReading(pose_base_camera=Pose.from_matrix(before.pose_base_camera.pose().matrix()))
            rows += camera_rows(before, read_calibration([after], reading), self.plant.behind)
        return rows + tool_rows(begun, load_cell(self.cell).workcell, self.plant.behind)


def table_of(walk: Walk, found: list[DayFigure]) -> list[Table]:
    """The results, and how the assemblies ended."""
    table = Table(title="what the calibrations found of what was hidden")
    for heading in ("", "off before", "off now", ""):
        table.add_column(heading, justify="left" if not heading else "right")
    for row in found:
        table.add_row(row.what, f"{row.before:.3f}", f"{row.after:.3f}", row.unit)
    ended = Table(title="assemblies")
    for heading in ("strategy", "ended", "vision", "motion, s", "peak, N", "vision, mm", "T2, mm", "T2, °"):
        ended.add_column(heading, justify="right")
    for one in walk.assemblies:
        numbers = [
            "" if value is None else f"{value:.{digits}f}"
            for value, digits in (
                (one.motion_s, 1), (one.peak_force_n, 1), (one.vision_error_mm, 3), (one.final_error_mm, 3),
                (one.final_error_deg, 3),
            )
        ]  # fmt: skip
        ended.add_row(one.strategy, "inserted" if one.inserted else str(one.failure), seen_in_words(one), *numbers)
    return [table, ended]
