"""`crosspih assemble`."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.config.drawing import CROSS, OUTLINES
from crosspih_common.errors import CrosspihError
from crosspih_common.messages import AssemblyResult, PosePrior, SimulationTruth, Strategy
from crosspih_common.recording import RecordingError
from deploy.launcher import LauncherError
from services.operator.for_cell import CELL_HELP
from services.operator.pegs import cell_with_peg
from services.operator.report import make_report
from services.operator.scoring import TrialFigures
from services.operator.session import using_cell
from services.operator.show import Story, pose_lines, summary
from services.operator.stack import cell_session


@dataclass(frozen=True, slots=True, eq=False)
class _Done:
    """One assembly that came to an end, with the report of its recording."""

    figures: TrialFigures
    result: AssemblyResult
    truth: SimulationTruth | None


def _assemble(
    console: Console, cell: Path | None, seed: int, strategy: Strategy, speed: str | None, record: bool,
    peg: str | None, known: PosePrior | None = None,
) -> _Done:  # fmt: skip
    with ExitStack() as stack:
        stack.enter_context(using_cell(cell))
        stack.enter_context(cell_with_peg(peg))
        with console.status("starting the cell"):
            session, _ = stack.enter_context(cell_session(speed))
        outline = session.cell.workcell.peg.shape().outline
        drawn = f"seed {seed}" if session.simulated else "no simulator: nothing is drawn, and nothing tells the truth"
        console.print(f"{drawn}, peg {outline.name}, strategy {strategy.value}, {session.speed()}", highlight=False)
        if outline.symmetry_order == 0:
            console.print("a round peg: nothing it touches tells how it is turned about its axis", highlight=False)
        story = Story(console)
        session.follow_events(story.phase, story.touch, story.event)
        figures, result = session.trial(
            seed, strategy, record, on_begin=story.begin, known=known, on_check=story.checking
        )
        truth = session.truth() if session.simulated else None
    if figures.recording is not None:
        page = Path(figures.recording).with_suffix(".html")
        try:
            with console.status("making the report"):
                make_report(Path(figures.recording), page)
            figures = figures.model_copy(update={"report": str(page)})
        except (RecordingError, OSError) as error:
            # the assembly's own end must be told
            said = (*figures.recording_warnings, f"no report: {error}")
            figures = figures.model_copy(update={"recording_warnings": said})
    return _Done(figures, result, truth)


def _print(console: Console, done: _Done) -> None:
    if done.result.pose_base_hole is not None:
        title = "T2, where the hole was found:" if done.result.inserted else "the hole as last believed:"
        console.print(pose_lines(title, done.result.pose_base_hole.pose().matrix().tolist()), highlight=False)
    if done.truth is not None:
        matrix = done.truth.pose_base_hole.pose().matrix().tolist()
        console.print(pose_lines("where it really is:", matrix), highlight=False)
    console.print(summary(done.figures))


def assemble(
    seed: Annotated[
        int, typer.Option(min=0, help="Draws the hole, the light and the noise of the simulated cell.")
    ] = 1,
    strategy: Annotated[Strategy, typer.Option(help="How to get the peg in.")] = Strategy.FUSED,
    peg: Annotated[
        str | None, typer.Option(help=f"{', '.join(OUTLINES)}, or an SVG or DXF file; the cell's own when left out.")
    ] = None,
    cell: Annotated[Path | None, typer.Option(help=CELL_HELP)] = None,
    after_cross: Annotated[
        bool, typer.Option("--after-cross", help="The cross first; then the peg, at the pose known from it, untouched.")
    ] = False,
    speed: Annotated[
        str | None, typer.Option(help="realtime, or max: the cell's clock runs only while a command does.")
    ] = None,
    record: Annotated[bool, typer.Option(help="Write a recording and its report.")] = True,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object on standard output, an array of two with --after-cross.")
    ] = False,
) -> None:
    """Do one assembly: on the running stack, or on one that is started for it and stopped afterwards."""
    console = Console(stderr=as_json)
    if speed not in (None, "realtime", "max"):
        console.print(f"--speed {speed}: want realtime or max", highlight=False)
        raise typer.Exit(2)
    if after_cross and peg in (None, CROSS):
        console.print("--after-cross: name the other peg with --peg, star for instance", highlight=False)
        raise typer.Exit(2)
    done: list[_Done] = []
    try:
        if after_cross:
            done.append(_assemble(console, cell, seed, strategy, speed, record, CROSS))
            found = done[0].figures.found
            if found is not None:
                if not as_json:
                    _print(console, done[0])
                said = f"the cross is swapped for the peg {peg}, and the insert of the plate for its hole"
                console.print(said, highlight=False)
                done.append(_assemble(console, cell, seed, Strategy.KNOWN_POSE, speed, record, peg, found))
        else:
            done.append(_assemble(console, cell, seed, strategy, speed, record, peg))
    except (CrosspihError, LauncherError) as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print("[red]interrupted: the peg was taken out[/red]")
        raise typer.Exit(130) from None
    if as_json:
        texts = [each.figures.model_dump_json() for each in done]
        sys.stdout.write((f"[{', '.join(texts)}]" if after_cross else texts[0]) + "\n")
    else:
        _print(console, done[-1])
    if not done[-1].figures.inserted:
        raise typer.Exit(1)
