"""`crosspih calibrate stiffness`, `mount` and `tcp`: by gentle pushes on the plate beside the hole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from crosspih_common.calibration.mount import MountFit, fit_mount
from crosspih_common.calibration.presses import Pressed
from crosspih_common.calibration.stiffness import StiffnessFit, fit_stiffness
from crosspih_common.calibration.tcp import TipFit, fit_tip
from crosspih_common.config import CellFile, load_cell
from services.operator.assembly.stack import cell_session
from services.operator.bench.options import AsJson, errors_shown
from services.operator.calibrate.folder import PRESSED, named_folder, new_folder, read_pressed, write_yaml
from services.operator.calibrate.options import (
    CellOption,
    OutOption,
    RecordOption,
    ShareOption,
    SpeedOption,
    needed,
    recorded,
    say_notes,
)
from services.operator.calibrate.pressing import PressingManner, take_presses
from services.operator.calibrate.recorded import is_recording, pressed_of
from services.operator.calibrate.settings import mount_settings, stiffness_settings, tcp_settings
from services.operator.calibrate.so_far import SoFar
from services.operator.calibrate.tables import values_table
from services.operator.calibrate.writing import CalibrationResult
from services.operator.cell.which_cell import cell_path, using_cell

NEEDED = ("hardware", "force_torque", "planning")
FROM_HELP = (
    "Offline: an earlier calibration of any of the three (its folder, its pressed.yaml, or `mount` for the newest of "
    "that name), or a recording (.mcap)."
)
FromOption = Annotated[Path | None, typer.Option("--from", help=FROM_HELP)]
PressesOption = Annotated[int, typer.Option(min=4, max=100, help="Pushes, each in another posture.")]
ForceOption = Annotated[float, typer.Option(min=4.0, max=40.0, help="The hardest push, N.")]


@dataclass(frozen=True, slots=True)
class PushCalibration:
    """One of the three. `reckon(pressed, cell)` is what was found, for JSON, and lines for people; it raises
    CalibrationRefused."""

    name: str
    doc: str
    title: str
    weighed: bool
    reckon: Callable[[Pressed, CellFile], tuple[dict[str, Any], list[str]]]


def _stiffness_told(fit: StiffnessFit, cell: CellFile) -> dict[str, Any]:
    """For JSON; lengths in m, stiffness in Nm/rad."""
    return {
        "values": [
            {
                "name": f"joint {index + 1}", "value": float(value), "sd": float(value * sd),
                "half_95": float(value * half), "unit": "Nm/rad" if taken else "Nm/rad, not taken", "taken": taken,
            }
            for index, (value, sd, half, taken) in enumerate(
                zip(fit.stiffness_nm_rad, fit.sd_share, fit.half_share, fit.taken, strict=True)
            )
        ],
        "tool_n_m": fit.tool_n_m, "tool_half_95_share": fit.tool_half_share, "rms_mm": fit.rms_m * 1e3,
        "held_out_mm": fit.held_out_m * 1e3, "moved_mm": fit.moved_m * 1e3, "pushes": fit.fit.groups,
        "missing": list(fit.missing), "doubts": list(fit.doubts), "settings": stiffness_settings(fit, cell),
    }  # fmt: skip


def _mount_told(fit: MountFit, cell: CellFile) -> dict[str, Any]:
    """For JSON; against the cell's file: the sensor's origin in the peg frame, m, and the turn of its axes, rad."""
    names = ("sensor rx", "sensor ry", "sensor rz", "sensor x", "sensor y", "sensor z")
    found, sd = np.concatenate([fit.turn_rad, fit.shift_m]), np.concatenate([fit.turn_sd_rad, fit.shift_sd_m])
    half = np.concatenate([fit.turn_half_rad, fit.shift_half_m])
    return {
        "values": [
            {"name": name, "value": float(value), "sd": float(one), "half_95": float(wide)}
            for name, value, one, wide in zip(names, found, sd, half, strict=True)
        ],
        "weight_n": fit.weight_n, "rms_n": fit.rms_n, "rms_nm": fit.rms_nm, "held_out_n": fit.held_out_n,
        "held_out_nm": fit.held_out_nm, "missing": list(fit.missing), "doubts": list(fit.doubts),
        "settings": mount_settings(fit, cell),
    }  # fmt: skip


def _tcp_told(fit: TipFit, cell: CellFile) -> dict[str, Any]:
    """For JSON, m."""
    return {
        "values": [
            {"name": f"peg {axis}", "value": float(value), "sd": float(sd), "half_95": float(half)}
            for axis, value, sd, half in zip("xyz", fit.shift_m, fit.sd_m, fit.half_m, strict=True)
        ],
        "tip_flange_m": fit.tip_flange_m.tolist(), "rms_mm": fit.rms_m * 1e3, "held_out_mm": fit.held_out_m * 1e3,
        "touches": fit.touches, "missing": list(fit.missing), "doubts": list(fit.doubts),
        "settings": tcp_settings(fit, cell),
    }  # fmt: skip


def _stiffness(pressed: Pressed, cell: CellFile) -> tuple[dict[str, Any], list[str]]:
    fit = fit_stiffness(pressed, cell.workcell)
    return _stiffness_told(fit, cell), [
        f"at the tool, along the plate's normal: {fit.tool_n_m * 1e-3:.1f} N/mm ± {fit.tool_half_share:.1%}",
        f"residual {fit.rms_m * 1e3:.5f} mm, left out {fit.held_out_m * 1e3:.5f} mm, of steps of "
        f"{fit.moved_m * 1e3:.4f} mm; {fit.fit.groups} pushes",
    ]


def _mount(pressed: Pressed, cell: CellFile) -> tuple[dict[str, Any], list[str]]:
    fit = fit_mount(pressed, cell.workcell)
    return _mount_told(fit, cell), [
        f"weight {fit.weight_n:.3f} N; the turn is by gravity, the place by pushes",
        f"residual {fit.rms_n:.4f} N, {fit.rms_nm:.5f} Nm",
        f"left out {fit.held_out_n:.4f} N, {fit.held_out_nm:.5f} Nm",
    ]


def _tcp(pressed: Pressed, cell: CellFile) -> tuple[dict[str, Any], list[str]]:
    fit = fit_tip(pressed, cell.workcell)
    tip = ", ".join(f"{value * 1e3:.3f}" for value in fit.tip_flange_m)
    return _tcp_told(fit, cell), [
        f"the middle of the tip is at ({tip}) mm of the flange",
        f"residual {fit.rms_m * 1e3:.5f} mm, left out {fit.held_out_m * 1e3:.5f} mm; {fit.touches} touches",
    ]


def _pressed(
    console: Console, kind: PushCalibration, cell: CellFile, given: Path | None, manner: PressingManner, share: float,
    speed: str | None, record: bool, folder: Path,
) -> Pressed:  # fmt: skip
    given = None if given is None else named_folder(cell.workcell.name, given)
    if given is None:
        with cell_session(speed, needed(NEEDED, record)) as (session, _), recorded(session, kind.name, record, console):
            shower = SoFar(console, kind.title, lambda pressed: kind.reckon(pressed, cell)[0])
            with shower:
                pressed = take_presses(session, console, manner, share, kind.name, kind.weighed, shower.show)
    elif is_recording(given):
        pressed, notes = pressed_of(given, cell.workcell)
        say_notes(console, notes)
    else:
        return read_pressed(given)
    write_yaml(folder / PRESSED, pressed.model_dump(mode="json"))
    return pressed


def _command(kind: PushCalibration) -> Callable[..., None]:
    def command(
        files: FromOption = None, presses: PressesOption = 16, force_n: ForceOption = 18.0, out: OutOption = None,
        cell: CellOption = None, share: ShareOption = 0.3, speed: SpeedOption = None, record: RecordOption = False,
        as_json: AsJson = False,
    ) -> None:  # fmt: skip
        console = Console(stderr=True)
        with errors_shown(console), using_cell(cell):
            file = load_cell(cell_path())
            folder = new_folder(file.workcell.name, kind.name)
            pressed = _pressed(
                console, kind, file, files, PressingManner(presses, force_n), share, speed, record, folder
            )
            result, lines = kind.reckon(pressed, file)

            def show(shown: Console) -> None:
                shown.print(values_table(kind.title, result["values"]))
                for line in lines:
                    shown.print(line, highlight=False, markup=False, soft_wrap=True)

            CalibrationResult(kind.name, file, folder, result, pressed.taken_at.isoformat(), out).conclude(
                as_json, show
            )

    command.__doc__, command.__name__ = kind.doc, kind.name
    return command


stiffness = _command(PushCalibration(
    "stiffness",
    "The joints' stiffness: how far the encoders go on, and how much harder it presses, against the rigid plate.",
    "stiffness between encoders and links", False, _stiffness,
))  # fmt: skip
mount = _command(PushCalibration(
    "mount", "How the force/torque sensor is mounted: its turn by gravity, its place by pushes on the tip's corners.",
    "the sensor against where the cell's file has it", True, _mount,
))  # fmt: skip
tcp = _command(PushCalibration(
    "tcp", "Where the peg's tip is on the flange: by touching one plate with several corners and tilts.",
    "the peg against where the cell's file has it", False, _tcp,
))  # fmt: skip
