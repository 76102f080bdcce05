"""Both halves of the paper's assembly over many seeds: first the cross, then another peg at the pose known from it."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from crosspih_common.errors import ConfigError
from crosspih_common.messages import Strategy
from services.operator.bench.cells.conditions import DEFAULT_PEG
from services.operator.bench.cells.trials import TrialJob, TrialsEnded
from services.operator.scoring.score import TrialFigures

Done = list[tuple[TrialJob, TrialFigures]]
Trials = tuple[Done, TrialsEnded | None]
Halves = tuple[Done, Done, TrialsEnded | None]


class NextPegWay(str, Enum):
    """How a peg that is not the cross is assembled."""

    DIRECT = "direct"  # vision and touch with that peg
    SWAP = "swap"  # the cross first; then this peg at the pose known from it, without vision or touch


def swapped(jobs: list[TrialJob], run: Callable[[str, list[TrialJob]], Trials]) -> Halves:
    """The second halves of all jobs, and the first ones; `run(title, jobs)` does trials.

    A seed whose cross did not insert counts with that result: without T2 there is no second half. Raises ConfigError
    when the jobs are the cross's own.
    """
    if any(job.peg == DEFAULT_PEG for job in jobs):
        raise ConfigError(f"--way {NextPegWay.SWAP.value}: name the other peg with --peg, star for instance")
    crosses, ended = run("cross", [job.model_copy(update={"peg": DEFAULT_PEG}) for job in jobs])
    pegs = {job.seed: job.peg for job in jobs}
    failed = [(job, figures) for job, figures in crosses if figures.found is None]
    if ended is not None:
        return failed, crosses, ended
    second = [
        job.model_copy(update={"peg": pegs[job.seed], "strategy": Strategy.KNOWN_POSE, "known": figures.found})
        for job, figures in crosses
        if figures.found is not None
    ]
    done, ended = run(Strategy.KNOWN_POSE.value, second) if second else ([], None)
    return sorted([*failed, *done], key=lambda pair: pair[0].seed), crosses, ended
