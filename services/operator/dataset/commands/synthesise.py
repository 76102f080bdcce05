"""`crosspih dataset synthesise`: contacts made by the mechanics, in the same table as those of the cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.datasets import read_contacts
from services.operator.bench.options import errors_shown
from services.operator.dataset.commands.collect import AngleRad, FirstSeed, LateralM, Poses
from services.operator.dataset.commands.describe import summary
from services.operator.other_services.inference_process import run_tool


def synthesise(
    poses: Poses = 20_000,
    seed: FirstSeed = 1,
    out: Annotated[Path, typer.Option(help="The data set's folder; samples in it are not made again.")] = Path(
        "run/synthetic-contacts"
    ),
    angle_rad: AngleRad = 0.1,
    lateral_m: LateralM = 0.005,
    force_n: Annotated[float, typer.Option(min=1.0, help="Force of every contact.")] = 20.0,
    friction: Annotated[float, typer.Option(min=0.0, max=1.0)] = 0.0,
    force_sd_n: Annotated[float, typer.Option(min=0.0, help="Noise of a force.")] = 0.0,
    moment_sd_nm: Annotated[float, typer.Option(min=0.0, help="Noise of a moment.")] = 0.0,
) -> None:
    """Single contacts of the cell's peg, made by the mechanics: thousands a second, no cell needed."""
    console = Console(stderr=True)
    with errors_shown(console):
        numbers = {
            "poses": poses, "seed": seed, "angle-rad": angle_rad, "lateral-m": lateral_m, "force-n": force_n,
            "friction": friction, "force-sd-n": force_sd_n, "moment-sd-nm": moment_sd_nm,
        }  # fmt: skip
        arguments = [word for name, value in numbers.items() for word in (f"--{name}", str(value))]
        run_tool(["synthesise", "--out", str(out), *arguments], console)
        Console().print(summary(out, read_contacts(out)))
