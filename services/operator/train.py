"""`crosspih train`: contacts collected in the cell over the bus, then the paper's network trained on them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from crosspih_common.errors import CommandRefused, CrosspihError
from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import COMPENSATE, FT_CALIBRATION, GUARDED_MOVE, SET_PAYLOAD
from crosspih_common.messages import (
    CompensateWrench,
    GuardedMove,
    PoseData,
    ResetCell,
    SetPayload,
    floats,
)
from deploy.launcher import LauncherError
from services.operator.session import Session
from services.operator.stack import cell_session

STANDOFF_M = 0.004
TRAVEL_LIMIT_M = 0.045
NEEDED = ("hardware", "force_torque", "planning")


def draw_pose_peg_hole(rng: np.random.Generator, angle_rad: float, lateral_m: float) -> tuple[Array, Array]:
    """Error angles (alpha, beta, gamma), uniform, and lateral offset (x, y) at the rim, uniform."""
    return rng.uniform(-angle_rad, angle_rad, 3), rng.uniform(-lateral_m, lateral_m, 2)


def start_pose_hole_peg(angles_rad: Array, lateral_m: Array, tip_m: float) -> Pose:
    """The peg before the hole with a wanted error: its tip on the standoff, its axis through the offset at the rim."""
    rotation_hole_peg = rotation_from_error_angles(angles_rad).T
    # the axis meets the face's plane at the offset; the tip stays short of it
    tip = np.array([*lateral_m, 0.0]) - rotation_hole_peg[:, 2] * (STANDOFF_M / rotation_hole_peg[2, 2])
    return Pose(rotation_hole_peg, tip - rotation_hole_peg[:, 2] * tip_m)


def _ready(session: Session) -> None:
    """A calibrated sensor, and an arm that knows its payload."""
    latest = session.bus.latest(FT_CALIBRATION).wait_for(lambda _: True, 10.0)
    calibration = latest if latest is not None and latest.calibrated else session.calibrate_ft(0.25)
    session.bus.call(
        SET_PAYLOAD,
        SetPayload(
            bias=calibration.bias,
            weight_n=calibration.weight_n,
            centroid_ft_m=calibration.centroid_m,
            gravity_base=calibration.gravity_base,
        ),
        10.0,
    )


def collect_one(
    session: Session, seed: int, angle_rad: float, lateral_m: float, threshold_n: float
) -> dict[str, Array]:
    """One contact: a drawn error, a guarded push along the peg's own axis, the compensated wrench.

    Raises CommandRefused when the cell cannot make it; ValueError when nothing was felt.
    """
    rng = np.random.default_rng(seed)
    angles, lateral = draw_pose_peg_hole(rng, angle_rad, lateral_m)
    pose_hole_peg = start_pose_hole_peg(angles, lateral, session.cell.workcell.peg.shape().tip_m)
    truth = session.reset(ResetCell(seed=seed, offset_hole=(0.0,) * 6, place_peg=PoseData.of(pose_hole_peg)))
    pose_base_peg = truth.pose_base_hole.pose() @ pose_hole_peg
    outcome = session.bus.call(
        GUARDED_MOVE,
        GuardedMove(
            direction_base=floats(pose_base_peg.rotation[:, 2]),
            speed_m_s=0.01,
            force_threshold_n=threshold_n,
            travel_limit_m=TRAVEL_LIMIT_M,
        ),
        60.0,
    )
    if outcome.wrench_observed_raw is None or outcome.pose_base_peg_observed is None:
        raise ValueError("felt nothing")
    reading = session.bus.call(
        COMPENSATE,
        CompensateWrench(
            pose_base_peg=outcome.pose_base_peg_observed,
            wrench_raw=outcome.wrench_observed_raw,
            wrench_sd=outcome.wrench_observed_sd or (0.02,) * 6,
        ),
        10.0,
    )
    pose_peg_hole = outcome.pose_base_peg_observed.pose().inverse() @ truth.pose_base_hole.pose()
    return {
        "wrench": np.asarray(reading.wrench),
        "angles_rad": angles,
        "translation_m": pose_peg_hole.translation_m,
        "state": np.array(reading.state.case or "none"),
    }


def collect(samples: int, seed: int, angle_rad: float, lateral_m: float, threshold_n: float, path: Path) -> int:
    """Collect contacts over the bus into an npz file; returns how many there are."""
    rows: list[dict[str, Array]] = []
    console = Console(stderr=True)
    columns = (
        TextColumn("collecting contacts"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with cell_session("max", NEEDED) as (session, _):
        _ready(session)
        with Progress(*columns, console=console) as progress:
            task = progress.add_task("", total=samples)
            for index in range(samples):
                try:
                    rows.append(collect_one(session, seed + index, angle_rad, lateral_m, threshold_n))
                except (CommandRefused, ValueError) as error:
                    progress.console.print(f"seed {seed + index}: {error}", highlight=False)
                progress.advance(task)
    if not rows:
        raise CommandRefused("no_contacts", "not one contact could be made")
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        np.savez_compressed(file, **{name: np.array([row[name] for row in rows]) for name in rows[0]})  # type: ignore[arg-type]
    return len(rows)


def train(
    samples: Annotated[int, typer.Option(min=10, help="Contacts to collect.")] = 600,
    seed: Annotated[int, typer.Option(min=0, help="The first contact's seed, and the network's.")] = 1,
    data: Annotated[Path, typer.Option(help="Contacts; collected when the file is not there.")] = Path(
        "run/contacts.npz"
    ),
    weights: Annotated[
        Path, typer.Option(help="Where the weights go; the cell's file names them as inference.weights.")
    ] = Path("run/network.safetensors"),
    angle_rad: Annotated[float, typer.Option(help="Half range of each error angle.")] = 0.1,
    lateral_m: Annotated[float, typer.Option(help="Half range of x and y at the rim.")] = 0.001,
    threshold_n: Annotated[float, typer.Option(help="Force at which a contact is read.")] = 15.0,
) -> None:
    """Collect contacts in the simulated cell over the bus and train the paper's 6-150-3 network on them."""
    console = Console()
    try:
        if data.exists():
            console.print(f"contacts in {data} are used as they are; remove the file to collect anew", highlight=False)
        else:
            count = collect(samples, seed, angle_rad, lateral_m, threshold_n, data)
            console.print(f"{count} contacts in {data}", highlight=False)
    except (CrosspihError, LauncherError) as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    weights.parent.mkdir(parents=True, exist_ok=True)
    # a process of its own: only inference and training need torch
    command = f"crosspih train --samples {samples} --seed {seed} --angle-rad {angle_rad} --lateral-m {lateral_m}"
    done = subprocess.run(
        [
            sys.executable, "-m", "services.inference.network",
            "--data", str(data), "--out", str(weights), "--seed", str(seed), "--command", command,
        ],
        check=False,
    )  # fmt: skip
    raise typer.Exit(done.returncode)
