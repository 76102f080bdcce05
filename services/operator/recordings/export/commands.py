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
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def export() -> None:
    """Recordings for other programs."""
