"""`crosspih calibrate ft`: what hangs behind the sensor, and its bias."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import FtCalibration
from services.operator.assembly.show import Story
from services.operator.assembly.stack import cell_session
from services.operator.bench.options import AsJson, errors_shown
from services.operator.calibrate.folder import new_folder
from services.operator.calibrate.options import CellOption, RecordOption, SpeedOption, needed, recorded, say_notes
from services.operator.calibrate.recorded import readings_of
from services.operator.cell.which_cell import cell_path, using_cell
from services.operator.other_services.beside import run_module

NEEDED = ("hardware", "force_torque", "planning")
OFFLINE = "services.force_torque.offline"
READINGS, FILE = "readings.json", "ft-calibration.yaml"


def ft(
    samples_s: Annotated[float, typer.Option(min=0.05, max=5.0, help="Dwell in each pose.")] = 0.25,
    files: Annotated[
        Path | None, typer.Option("--from", help="Offline: a recording (.mcap) of it, or of `calibrate mount`.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="With --from: where the calibration's file goes; else into run/, unused.")
    ] = None,
    speed: SpeedOption = None,
    cell: CellOption = None,
    temperature: Annotated[
        float | None, typer.Option(help="Of the sensor now, °C: crosspih doctor compares with it later.")
    ] = None,
    record: RecordOption = False,
    as_json: AsJson = False,
) -> None:
    """Drive the calibration poses and find the sensor's bias, the weight and the centroid behind it (Eqs. 14-16)."""
    console = Console(stderr=as_json)
    with errors_shown(console), using_cell(cell):
        if files is not None:
            found = _again(files, Path(cell_path()), out, temperature, console)
        elif out is not None:
            raise ConfigError("--out: only with --from; else it goes where force_torque.calibration_file says")
        else:
            with cell_session(speed, needed(NEEDED, record)) as (session, _), recorded(session, "ft", record, console):
                story = Story(console)
                session.follow_events(story.phase, story.touch, story.event)
                story.begin(session.bus.clock.now_ns())
                found = session.calibrate_ft(samples_s, temperature)
        if as_json:
            print(json.dumps(found.model_dump(mode="json")))
        else:
            _show(console, found)


def _again(
    recording: Path, cell: Path, out: Path | None, temperature_c: float | None, console: Console
) -> FtCalibration:
    """What the force_torque service's own reckoning says of recorded readings. Raises CrosspihError."""
    workcell = load_cell(cell).workcell
    asked, notes = readings_of(recording, workcell)
    say_notes(console, notes)
    if temperature_c is not None:
        asked = asked.model_copy(update={"temperature_c": temperature_c})
    folder = new_folder(workcell.name, "ft")
    readings, target = folder / READINGS, folder / FILE if out is None else out
    readings.write_text(asked.model_dump_json(), encoding="utf-8")
    said = run_module(OFFLINE, str(readings), "--cell", str(cell), "--out", str(target))
    answer: dict[str, Any] = said.value if isinstance(said.value, dict) else {}
    if "refused" in answer:
        raise CalibrationRefused(str(answer["refused"]))
    if "found" not in answer:
        raise ConfigError(f"{recording}: {said.words}")
    return FtCalibration.model_validate(answer["found"])


def _show(console: Console, found: FtCalibration) -> None:
    fx, fy, fz, mx, my, mz = found.bias
    x, y, z = (value * 1e3 for value in found.centroid_m)
    console.print(
        f"bias      ({fx:+.4f}, {fy:+.4f}, {fz:+.4f}) N  ({mx:+.4f}, {my:+.4f}, {mz:+.4f}) Nm", highlight=False
    )
    console.print(f"weight    {found.weight_n:.4f} N", highlight=False)
    console.print(f"centroid  ({x:+.2f}, {y:+.2f}, {z:+.2f}) mm ahead of the sensor", highlight=False)
    console.print(
        f"residuals {found.residual_force_n:.4f} N, {found.residual_moment_nm:.5f} Nm over {found.poses} poses",
        highlight=False,
    )
    console.print(f"saved     {found.file} ({found.date})", highlight=False, soft_wrap=True)
