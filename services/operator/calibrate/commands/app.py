"""`crosspih calibrate`. One module a kind of measurement."""

import typer

from services.operator.cli.on_demand import OnDemand, group_of

_HERE = "services.operator.calibrate.commands"
COMMANDS = {
    "ft": OnDemand(
        f"{_HERE}.ft:ft",
        "Drive the calibration poses and find the sensor's bias, the weight and the centroid behind it (Eqs. 14-16).",
        example="--speed max",
    ),
    "board": OnDemand(
        f"{_HERE}.board:board",
        "Write the ChArUco board to print: at 100 %, on something flat and stiff; check the ruler on it.",
        example="board.pdf",
    ),
    "stereo": OnDemand(
        f"{_HERE}.stereo:stereo",
        "Both lenses and where the right camera stands, by a ChArUco board; written as locate and drivers read it.",
        example="--cell my-cell.yaml",
    ),
    "hand-eye": OnDemand(
        f"{_HERE}.hand_eye:hand_eye",
        "Where the cameras stand in the arm's base: the arm shows them a ChArUco board on its flange.",
        example="--cell my-cell.yaml",
    ),
    "tcp": OnDemand(
        f"{_HERE}.pushes:tcp",
        "Where the peg's tip is on the flange: by touching one plate with several corners and tilts.",
        example="--cell my-cell.yaml",
    ),
    "mount": OnDemand(
        f"{_HERE}.pushes:mount",
        "How the force/torque sensor is mounted: its turn by gravity, its place by pushes on the tip's corners.",
        example="--cell my-cell.yaml",
    ),
    "stiffness": OnDemand(
        f"{_HERE}.pushes:stiffness",
        "The joints' stiffness: how far the encoders go on, and how much harder it presses, against the rigid plate.",
        example="--cell my-cell.yaml",
    ),
    "refine": OnDemand(
        f"{_HERE}.refine:refine",
        "Refine taper, clearance, F/T sensor and camera over past recordings of this cell.",
        example="recordings/assembly-fused-seed1.mcap recordings/assembly-fused-seed2.mcap",
    ),
}

app = typer.Typer(cls=group_of(COMMANDS), no_args_is_help=True)


@app.callback()
def calibrate() -> None:
    """Calibrations of the cell."""
