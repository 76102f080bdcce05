"""`crosspih withdraw`: take a seated peg straight out, under a force watch."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.messages import Withdraw
from services.operator.assembly.show import Story
from services.operator.assembly.stack import START_DEADLINE_S, running_session
from services.operator.bench.options import AsJson, errors_shown

NEEDED = ("hardware", "force_torque", "planning")


def withdraw(
    clear_mm: Annotated[float, typer.Option(min=1.0, max=100.0, help="Tip to the hole's face at the end.")] = 30.0,
    speed_mm_s: Annotated[float, typer.Option(min=0.1, max=50.0, help="How fast it is drawn.")] = 10.0,
    force_limit_n: Annotated[float, typer.Option(min=1.0, help="More pull than this: it is stuck, and left.")] = 20.0,
    as_json: AsJson = False,
) -> None:
    """Take a seated peg straight out along its own axis, slowly; stop where it resists (status 1)."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        with running_session(NEEDED, START_DEADLINE_S) as session:
            session.require_sound_cell()
            story = Story(console)
            session.follow_events(story.phase, story.touch, story.event)
            story.begin(session.bus.clock.now_ns())
            result = session.withdraw(
                Withdraw(clear_m=clear_mm * 1e-3, speed_m_s=speed_mm_s * 1e-3, force_limit_n=force_limit_n)
            )
        if as_json:
            sys.stdout.write(result.model_dump_json() + "\n")
        else:
            verdict = "out" if result.failure is None else f"{result.failure.value}: {result.failure_detail}"
            console.print(
                f"{verdict}, {result.distance_m * 1e3:.1f} mm in {result.motion_s:.1f} s, peak "
                f"{result.peak_force_n:.1f} N, {result.peak_moment_nm:.2f} Nm",
                highlight=False,
            )
        if not result.withdrawn:
            raise typer.Exit(1)
