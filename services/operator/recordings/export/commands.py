"""The commands `crosspih recording export …`."""

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.recordings.export"
_FILE = "recordings/assembly-fused-seed7.mcap"
COMMANDS = {
    "csv": OnDemand(
        f"{_HERE}.into_tables:csv",
        "Write a recording as CSV files, one a key: for spreadsheets. Pictures without their bytes.",
        example=f"{_FILE} tables",
    ),
    "parquet": OnDemand(
        f"{_HERE}.into_tables:parquet",
        "Write a recording as Parquet files, one a key: for pandas, Polars, DuckDB.",
        example=f"{_FILE} tables",
    ),
    "ros2": OnDemand(
        f"{_HERE}.ros2:ros2",
        "Write a recording as a ROS 2 bag (MCAP, CDR): for `ros2 bag play`, rosbags, PlotJuggler and others.",
        example=f"{_FILE} bag",
    ),
    "foxglove": OnDemand(
        f"{_HERE}.foxglove:foxglove",
        "Write a recording with topics for Foxglove, Lichtblick and Rerun: of one that has none, or made anew.",
        example=f"{_FILE} for-viewers.mcap",
    ),
    "layouts": OnDemand(
        f"{_HERE}.layouts:layouts",
        "Write the layouts for Foxglove and Lichtblick with the name of a recording's cell, where it is not cell1.",
        example=f"{_FILE} layouts",
    ),
    "rerun": OnDemand(
        f"{_HERE}.rerun:rerun",
        "Write a recording for the Rerun viewer: the cell in 3-D, pictures, forces at full rate, joints, log.",
        example=f"{_FILE} assembly.rrd",
    ),
    "lerobot": OnDemand(
        f"{_HERE}.lerobot.command:lerobot",
        "Write assemblies as a LeRobot dataset (v3.0), an episode each: joints, wrench, peg, video, phases, success.",
        example=f"{_FILE} -o my-dataset",
    ),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def export() -> None:
    """Recordings for other programs."""
