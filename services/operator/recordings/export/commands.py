"""`crosspih recording export`: recordings in other programs' formats."""

import typer

from services.operator.recordings.export.foxglove import foxglove
from services.operator.recordings.export.into_tables import csv, parquet
from services.operator.recordings.export.lerobot.command import lerobot
from services.operator.recordings.export.rerun import rerun
from services.operator.recordings.export.ros2 import ros2

export_app = typer.Typer(no_args_is_help=True, help="Recordings for other programs.")
export_app.command()(csv)
export_app.command()(parquet)
export_app.command()(ros2)
export_app.command()(foxglove)
export_app.command()(lerobot)
export_app.command()(rerun)
