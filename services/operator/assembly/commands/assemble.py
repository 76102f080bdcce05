"""`crosspih assemble`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.config.drawing import CROSS, OUTLINES
from crosspih_common.errors import CrosspihError
from crosspih_common.messages import AssemblyResult, PosePrior, SimulationTruth, Strategy
from crosspih_common.messages.assembly import AnyStrategy
from crosspih_common.recording import RecordingError
from services.operator.assembly.as_bench import bench_session
from services.operator.assembly.display.live import live_story
from services.operator.assembly.pegs import cell_with_peg
from services.operator.assembly.session import Session
from services.operator.assembly.show import pose_lines, summary
from services.operator.assembly.stack import cell_session
from services.operator.bench.cells.conditions import DEFAULT_PEG, Condition, condition_of
from services.operator.bench.cells.trials import TrialJob
from services.operator.cell.settings import require_settings
from services.operator.cell.which_cell import using_cell
from services.operator.cli.chosen_strategy import STRATEGY_HELP, chosen
from services.operator.cli.failure import CommandFailure, Failed, failure_of
from services.operator.cli.for_cell import CELL_HELP
from services.operator.report import make_report
from services.operator.scoring.score import TrialFigures


@dataclass(frozen=True, slots=True, eq=False)
class _Done:
    """One finished assembly, with the report of its recording."""

    figures: TrialFigures
    result: AssemblyResult
    truth: SimulationTruth | None


@dataclass(frozen=True, slots=True)
class _Cell:
    """Chooses the cell: the running one, one like it, or with `bench` one as a bench makes it for the
    trial of a row.
    """

    file: Path | None
    speed: str | None
    bench: bool
    condition: Condition

    @contextmanager
    def session(self, job: TrialJob, peg: str | None, record: bool) -> Iterator[Session]:
        """The session in which the assembly runs."""
        with using_cell(self.file):
            if self.bench:
                with bench_session(job, record) as session:
                    yield session
            else:
                with cell_with_peg(peg), cell_session(self.speed) as (session, _):
                    yield session


def _assemble(
    console: Console, cell: _Cell, seed: int, strategy: AnyStrategy, record: bool, peg: str | None,
    plain: bool, known: PosePrior | None = None,
) -> _Done:  # fmt: skip
    job = TrialJob(seed=seed, strategy=strategy, condition=cell.condition, peg=peg or DEFAULT_PEG, known=known)
    with ExitStack() as stack:
        with console.status("starting the cell"):
            session = stack.enter_context(cell.session(job, peg, record))
        outline = session.cell.workcell.peg.shape().outline
        drawn = f"seed {seed}" if session.simulated else "no simulator: nothing is drawn, and nothing tells the truth"
        console.print(f"{drawn}, peg {outline.name}, strategy {strategy.value}, {session.speed()}", highlight=False)
        if outline.symmetry_order == 0:
            console.print("a round peg: nothing it touches tells how it is turned about its axis", highlight=False)
        title = f"seed {seed}, peg {outline.name}, {strategy.value}"
        with live_story(console, session, title, plain) as story:
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
            # the assembly's own end must still be reported
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
    as_bench: Annotated[
        bool,
        typer.Option(
            "--as-bench", help="The trial that a bench makes of this seed, to the last bit, in a cell of its own."
        ),
    ] = False,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="With --as-bench: a setting of the cell's file, as for the bench.")
    ] = None,
    strategy: Annotated[str, typer.Option(help=STRATEGY_HELP)] = Strategy.FUSED.value,
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
    plain: Annotated[
        bool, typer.Option("--plain", help="Lines alone, as into a file, and no panel below them.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object on standard output, an array of two with --after-cross.")
    ] = False,
) -> None:
    """Do one assembly: on the running stack, or on one that is started for it and stopped afterwards.

    Without --as-bench a seed draws the same hole, light and noise, but the force/torque sensor's calibration is the one
    that the cell has, and in real time no two runs are the same.
    """
    console = Console(stderr=as_json)
    if speed not in (None, "realtime", "max"):
        raise typer.BadParameter(f"{speed}: want realtime or max", param_hint="--speed")
    if after_cross and peg in (None, CROSS):
        raise typer.BadParameter("name the other peg with --peg, star for instance", param_hint="--after-cross")
    if as_bench and speed == "realtime":
        raise typer.BadParameter("a bench's cells run at max; leave --speed out", param_hint="--as-bench")
    if settings and not as_bench:
        raise typer.BadParameter("only with --as-bench; else write it into the cell's file", param_hint="--set")
    done: list[_Done] = []
    try:
        with using_cell(cell):
            require_settings(settings or ())
        how = chosen(strategy)
        where = _Cell(cell, speed, as_bench, condition_of(settings or ()))
        if after_cross:
            done.append(_assemble(console, where, seed, how, record, CROSS, plain))
            found = done[0].figures.found
            if found is not None:
                if not as_json:
                    _print(console, done[0])
                said = f"the cross is swapped for the peg {peg}, and the insert of the plate for its hole"
                console.print(said, highlight=False)
                done.append(_assemble(console, where, seed, Strategy.KNOWN_POSE, record, peg, plain, found))
        else:
            done.append(_assemble(console, where, seed, how, record, peg, plain))
    except CrosspihError as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise Failed(failure_of(error)) from None
    except KeyboardInterrupt:
        said = "interrupted: the peg was taken out"
        console.print(said, style="red")
        raise Failed(CommandFailure("interrupted", said), 130) from None
    if as_json:
        texts = [each.figures.model_dump_json() for each in done]
        sys.stdout.write((f"[{', '.join(texts)}]" if after_cross else texts[0]) + "\n")
    else:
        _print(console, done[-1])
    if not done[-1].figures.inserted:
        raise typer.Exit(1)
