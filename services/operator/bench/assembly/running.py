"""Trials on the running stack, one after the other: reset between them where there is a simulator, else withdrawn."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from crosspih_common.errors import CrosspihError
from crosspih_common.messages import Withdraw, WithdrawResult
from services.operator.assembly.session import Session
from services.operator.assembly.show import Story
from services.operator.assembly.stack import cell_session
from services.operator.bench.cells.bar import Bar
from services.operator.bench.cells.trials import TrialJob, TrialsEnded, TrialsStopped
from services.operator.scoring.repeatability import Repeatability, repeatability
from services.operator.scoring.score import TrialFigures

Done = list[tuple[TrialJob, TrialFigures]]


class NotWithdrawn(CrosspihError):
    """The peg is still in its hole: no further trial can be made."""


def on_the_running_stack(
    console: Console, jobs: list[TrialJob], record: bool
) -> tuple[Done, TrialsEnded | None, list[WithdrawResult] | None]:
    """(trials, the error that ended them early or None, the withdrawals of a cell without a simulator)."""
    done: Done = []
    withdrawals: list[WithdrawResult] | None = None
    try:
        with cell_session(None) as (session, _), Bar(console) as bar:
            if not session.simulated:
                withdrawals = []
            for job in bar.track(jobs, description=jobs[0].strategy.value):
                figures, _ = session.trial(job.seed, job.strategy, record, on_check=Story(console).checking)
                done.append((job, figures))
                if withdrawals is not None and figures.inserted:
                    withdrawals.append(_withdrawn(session))
                elif not figures.inserted:
                    console.print(f"trial {len(done)}: {figures.failure} {figures.failure_detail}", style="red")
                    if withdrawals is not None and not figures.backed_off:
                        raise NotWithdrawn("the peg was not backed off: see to it before the next trial")
    except CrosspihError as error:
        return done, TrialsEnded(f"ended after {len(done)} of {len(jobs)} trials: {error}", done), withdrawals
    except KeyboardInterrupt:
        return done, TrialsStopped(f"stopped after {len(done)} of {len(jobs)} trials", done), withdrawals
    return done, None, withdrawals


def _withdrawn(session: Session) -> WithdrawResult:
    result = session.withdraw(Withdraw())
    if not result.withdrawn:
        failure = "" if result.failure is None else result.failure.value
        raise NotWithdrawn(f"the peg could not be withdrawn: {failure}: {result.failure_detail}")
    return result


def repeated(done: Done, symmetry_order: int) -> Repeatability | None:
    """The spread of T2 over the trials that inserted."""
    poses = [figures.found.pose_base_hole.pose() for _, figures in done if figures.found is not None]
    return repeatability(poses, symmetry_order)


def repeatability_table(spread: Repeatability, withdrawals: list[WithdrawResult]) -> Table:
    """The repeatability of T2, and the duration of the withdrawals."""
    table = Table(title=f"T2 of {spread.count} assemblies of the same hole, about their mean")
    table.add_column("")
    table.add_column("sd", justify="right")
    table.add_column("largest", justify="right")
    table.add_row("across the axis, mm", f"{spread.sd_lateral_mm:.4f}", f"{spread.largest_lateral_mm:.4f}")
    table.add_row("along the axis, mm", f"{spread.sd_depth_mm:.4f}", "")
    table.add_row("tilt, °", f"{spread.sd_tilt_deg:.4f}", "")
    if spread.sd_turn_deg is not None:
        table.add_row("turn about the axis, °", f"{spread.sd_turn_deg:.4f}", "")
    table.add_row("whole rotation, °", "", f"{spread.largest_rotation_deg:.4f}")
    if withdrawals:
        peak_n = max(one.peak_force_n for one in withdrawals)
        seconds = sum(one.motion_s for one in withdrawals) / len(withdrawals)
        table.caption = f"{len(withdrawals)} withdrawals, {seconds:.1f} s each, peak force at most {peak_n:.1f} N"
    return table
