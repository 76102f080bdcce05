"""`crosspih recording export lerobot`: assemblies as a dataset for imitation learning."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.arm.description import default_joint_names
from crosspih_common.errors import ConfigError
from crosspih_common.recording import read_recording
from services.operator.bench.options import errors_shown
from services.operator.recordings.export.lerobot.episodes import NEEDED, episodes_of
from services.operator.recordings.export.lerobot.writing import Dataset
from services.operator.recordings.export.shown import cell_of


def lerobot(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings (.mcap) of one cell's arm.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The dataset: a folder that is made.")],
    fps: Annotated[int, typer.Option(min=1, max=250, help="Steps a second of cell time.")] = 30,
) -> None:
    """Write assemblies as a LeRobot dataset (v3.0), an episode each: joints, wrench, peg, video, phases, success."""
    console = Console()
    with errors_shown(console):
        dataset, arm, count = None, "", 0
        for path in recordings:
            recording = read_recording(path, NEEDED)
            workcell = cell_of(recording).workcell
            model = workcell.arm()
            if dataset is None:
                arm = model.name
                dataset = Dataset(out, arm, default_joint_names(model), fps)
            elif model.name != arm:
                raise ConfigError(f"{path}: its arm is {model.name}, that of the first recording {arm}")
            for episode in episodes_of(recording, workcell, fps):
                dataset.add(episode)
                outcome = "inserted" if episode.inserted else "not inserted"
                console.print(f"{count:5d}  {episode.length:6d} steps  {outcome}  {path.name}", highlight=False)
                count += 1
        if dataset is not None:
            dataset.finish()
