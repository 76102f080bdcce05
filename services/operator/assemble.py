"""`crosspih assemble` and `crosspih calibrate ft`."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import CrosspihError
from crosspih_common.messages import AssemblyResult, Strategy
from deploy.launcher import LauncherError
from services.operator.report import make_report
from services.operator.scoring import TrialFigures
from services.operator.session import Session
from services.operator.show import Story, pose_lines, summary
from services.operator.stack import cell_session

calibrate_app = typer.Typer(no_args_is_help=True, help="Calibrations of the cell.")


def _run(
    session: Session, console: Console, seed: int | None, strategy: Strategy, record: bool
) -> tuple[TrialFigures, AssemblyResult]:
    story = Story(console)
    session.follow_events(story.phase, story.touch, story.event)
    return session.trial(seed, strategy, record, on_begin=story.begin)


def assemble(
    seed: Annotated[
        int, typer.Option(min=0, help="Draws the hole, the light and the noise of the simulated cell.")
    ] = 1,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    speed: Annotated[
        str | None, typer.Option(help="realtime, or max: the cell's clock runs only while a command does.")
    ] = None,
    record: Annotated[bool, typer.Option(help="Write a recording and its report.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> None:
    """Do one assembly: on the running stack, or on one that is started for it and stopped afterwards."""
    console = Console(stderr=as_json)
    if speed not in (None, "realtime", "max"):
        console.print(f"--speed {speed}: want realtime or max", highlight=False)
        raise typer.Exit(2)
    try:
        with ExitStack() as stack:
            with console.status("starting the cell"):
                session, _ = stack.enter_context(cell_session(speed))
            console.print(f"seed {seed}, strategy {strategy.value}, {session.speed()}", highlight=False)
            figures, result = _run(session, console, seed, strategy, record)
            truth = session.truth()
    except (CrosspihError, LauncherError) as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print("[red]interrupted: the peg was taken out[/red]")
        raise typer.Exit(130) from None
    if figures.recording is not None:
        page = Path(figures.recording).with_suffix(".html")
        with console.status("making the report"):
            make_report(Path(figures.recording), page)
        figures = figures.model_copy(update={"report": str(page)})
    if as_json:
        sys.stdout.write(figures.model_dump_json() + "\n")
    else:
        if result.pose_base_hole is not None:
            title = "T2, where the hole was found:" if result.inserted else "the hole as last believed:"
            console.print(pose_lines(title, result.pose_base_hole.pose().matrix().tolist()), highlight=False)
        if truth is not None:
            console.print(
                pose_lines("where it really is:", truth.pose_base_hole.pose().matrix().tolist()), highlight=False
            )
        console.print(summary(figures))
    if not figures.inserted:
        raise typer.Exit(1)


@calibrate_app.command("ft")
def calibrate_ft(
    samples_s: Annotated[float, typer.Option(min=0.05, max=5.0, help="Dwell in each pose.")] = 0.25,
    speed: Annotated[str | None, typer.Option(help="realtime or max.")] = None,
) -> None:
    """Drive the calibration poses and find the sensor's bias, the weight and the centroid behind it (Eqs. 14-16)."""
    console = Console()
    try:
        with cell_session(speed, ("hardware", "force_torque", "planning")) as (session, _):
            story = Story(console)
            session.follow_events(story.phase, story.touch, story.event)
            story.begin(session.bus.clock.now_ns())
            found = session.calibrate_ft(samples_s)
    except (CrosspihError, LauncherError) as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
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
    console.print(f"saved     {found.file} ({found.date})", highlight=False)
