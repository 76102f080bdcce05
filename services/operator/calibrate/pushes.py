"""`crosspih calibrate stiffness`, `mount` and `tcp`: by gentle pushes on the plate beside the hole."""

from __future__ import annotations

import json
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
from services.operator.bench.options import AsJson, told
from services.operator.calibrate.folder import PRESSED, new_folder, read_pressed, write_yaml
from services.operator.calibrate.pressing import Manner, take_presses
from services.operator.calibrate.settings import mount_settings, stiffness_settings, tcp_settings
from services.operator.calibrate.tables import say_missing, values_table
from services.operator.calibrate.writing import write_cell_file, write_found
from services.operator.for_cell import CELL_HELP
from services.operator.session import cell_path, using_cell
from services.operator.stack import cell_session

NEEDED = ("hardware", "force_torque", "planning")
CellOption = Annotated[Path | None, typer.Option(help=CELL_HELP)]
FromOption = Annotated[
    Path | None, typer.Option("--from", help="Offline: pressed.yaml of an earlier calibration of any of the three.")
]
OutOption = Annotated[Path | None, typer.Option(help="Where the cell's file goes with what was found.")]
PressesOption = Annotated[int, typer.Option(min=4, max=100, help="Pushes, each in another posture.")]
ForceOption = Annotated[float, typer.Option(min=4.0, max=40.0, help="The hardest push, N.")]
ShareOption = Annotated[float, typer.Option(min=0.02, max=1.0, help="Of the arm's own speed limits, in free air.")]
SpeedOption = Annotated[str | None, typer.Option(help="realtime or max, of a cell that is started for it.")]


def _pressed(
    console: Console, what: str, cell: CellFile, given: Path | None, manner: Manner, share: float, speed: str | None,
    weighed: bool,
) -> tuple[Pressed, Path]:  # fmt: skip
    folder = new_folder(cell.workcell.name, what)
    if given is not None:
        return read_pressed(given), folder
    with cell_session(speed, NEEDED) as (session, _):
        pressed = take_presses(session, console, manner, share, what, weighed)
    write_yaml(folder / PRESSED, pressed.model_dump(mode="json"))
    return pressed, folder


def stiffness_told(fit: StiffnessFit, cell: CellFile) -> dict[str, Any]:
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


def mount_told(fit: MountFit, cell: CellFile) -> dict[str, Any]:
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


def tcp_told(fit: TipFit, cell: CellFile) -> dict[str, Any]:
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


def _finish(
    kind: str, title: str, lines: list[str], result: dict[str, Any], pressed: Pressed, folder: Path, cell: Path,
    name: str, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    result["taken_at"] = pressed.taken_at.isoformat()
    written = write_found(folder, kind, name, result)
    if out is not None:
        write_cell_file(out, cell, result["settings"], kind, written)
    if as_json:
        print(json.dumps({**result, "found": str(written)}))
        return
    shown = Console()
    shown.print(values_table(title, result["values"]))
    for line in lines:
        shown.print(line, highlight=False, markup=False, soft_wrap=True)
    say_missing(shown, result)
    if out is not None:
        shown.print(f"cell:  {out}", highlight=False, soft_wrap=True)
    shown.print(f"found: {written}", highlight=False, soft_wrap=True)


def stiffness(
    files: FromOption = None, presses: PressesOption = 16, force_n: ForceOption = 18.0, out: OutOption = None,
    cell: CellOption = None, share: ShareOption = 0.3, speed: SpeedOption = None, as_json: AsJson = False,
) -> None:  # fmt: skip
    """The joints' stiffness: how far the encoders go on, and how much harder it presses, against the rigid plate."""
    console = Console(stderr=True)
    with told(console), using_cell(cell):
        path = Path(cell_path())
        file = load_cell(path)
        pressed, folder = _pressed(
            console, "stiffness", file, files, Manner(presses, force_n), share, speed, weighed=False
        )
        fit = fit_stiffness(pressed, file.workcell)
        result = stiffness_told(fit, file)
        lines = [
            f"at the tool, along the plate's normal: {fit.tool_n_m * 1e-3:.1f} N/mm ± {fit.tool_half_share:.1%}",
            f"residual {fit.rms_m * 1e3:.5f} mm, left out {fit.held_out_m * 1e3:.5f} mm, of steps of "
            f"{fit.moved_m * 1e3:.4f} mm; {fit.fit.groups} pushes",
        ]
        _finish("stiffness", "stiffness between encoders and links", lines, result, pressed, folder, path,
                file.workcell.name, out, as_json)  # fmt: skip


def mount(
    files: FromOption = None, presses: PressesOption = 16, force_n: ForceOption = 18.0, out: OutOption = None,
    cell: CellOption = None, share: ShareOption = 0.3, speed: SpeedOption = None, as_json: AsJson = False,
) -> None:  # fmt: skip
    """How the force/torque sensor is mounted: its turn by gravity, its place by pushes on the tip's corners."""
    console = Console(stderr=True)
    with told(console), using_cell(cell):
        path = Path(cell_path())
        file = load_cell(path)
        pressed, folder = _pressed(console, "mount", file, files, Manner(presses, force_n), share, speed, weighed=True)
        fit = fit_mount(pressed, file.workcell)
        result = mount_told(fit, file)
        lines = [
            f"weight {fit.weight_n:.3f} N; the turn is by gravity, the place by pushes",
            f"residual {fit.rms_n:.4f} N, {fit.rms_nm:.5f} Nm",
            f"left out {fit.held_out_n:.4f} N, {fit.held_out_nm:.5f} Nm",
        ]
        _finish("mount", "the sensor against where the cell's file has it", lines, result, pressed, folder, path,
                file.workcell.name, out, as_json)  # fmt: skip


def tcp(
    files: FromOption = None, presses: PressesOption = 16, force_n: ForceOption = 18.0, out: OutOption = None,
    cell: CellOption = None, share: ShareOption = 0.3, speed: SpeedOption = None, as_json: AsJson = False,
) -> None:  # fmt: skip
    """Where the peg's tip is on the flange: by touching one plate with several corners and tilts."""
    console = Console(stderr=True)
    with told(console), using_cell(cell):
        path = Path(cell_path())
        file = load_cell(path)
        pressed, folder = _pressed(console, "tcp", file, files, Manner(presses, force_n), share, speed, weighed=False)
        fit = fit_tip(pressed, file.workcell)
        result = tcp_told(fit, file)
        tip = ", ".join(f"{value * 1e3:.3f}" for value in fit.tip_flange_m)
        lines = [
            f"the middle of the tip is at ({tip}) mm of the flange",
            f"residual {fit.rms_m * 1e3:.5f} mm, left out {fit.held_out_m * 1e3:.5f} mm; {fit.touches} touches",
        ]
        _finish("tcp", "the peg against where the cell's file has it", lines, result, pressed, folder, path,
                file.workcell.name, out, as_json)  # fmt: skip
