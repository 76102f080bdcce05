"""Trials side by side in separate cells, without those that a store already has."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from crosspih_common.config.cell import standing_alone
from crosspih_common.errors import ConfigError, CrosspihError
from crosspih_common.messages import Failure, PosePrior, Strategy, strategy_of
from crosspih_common.messages.assembly import AnyStrategy
from crosspih_common.plain_yaml import MAX_BYTES, text_of_file, yaml_of
from crosspih_common.provenance import ResultStore, SourceWatch, cell_identity, code_version, result_key
from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.cells.conditions import DEFAULT_PEG, Condition, cell_content
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.own_code_of import own_code_of
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.cell.which_cell import cell_path
from services.operator.scoring.score import TrialFigures

# these figures differ from run to run: all others are equal to the last bit
WALL_FIGURES = ("thinking_s", "duration_s", "wall_s", "challenge_score")
DEFAULT_STORE = Path("results/trials.jsonl")


class TrialJob(BaseModel):
    """One trial: everything that determines its result, except for the cell's file and the code."""

    model_config = ConfigDict(frozen=True)

    seed: int
    strategy: AnyStrategy = Strategy.FUSED
    condition: Condition = Condition()
    peg: str = DEFAULT_PEG
    known: PosePrior | None = None  # the pose of the hole, for the strategy known_pose


class TrialsEnded(CrosspihError):
    """Not all trials could be made; `done` holds those that were, and the store has them too."""

    def __init__(self, text: str, done: list[tuple[TrialJob, TrialFigures]]) -> None:
        super().__init__(text)
        self.done = done


class TrialsStopped(TrialsEnded):
    """Somebody stopped the run."""


def base_cell_text() -> str:
    """The cell's file from which conditions are made: that of CROSSPIH_CELL, or the default; valid also when written to
    another folder. Raises ConfigError.
    """
    path = Path(cell_path())
    try:
        text = text_of_file(path, MAX_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); name a cell file with CROSSPIH_CELL") from error
    try:
        content = yaml_of(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: is not YAML: {error}") from None
    alone = standing_alone(path, content) if isinstance(content, dict) else content
    return text if alone == content else yaml.safe_dump(alone, sort_keys=False)


def trial_key(content: dict[str, Any], job: TrialJob, code: str) -> str:
    """The key under which a trial is stored. The names of the cell and of the condition do not count. Of the files that
    the cell names (weights, drawings, pictures, calibrations) the content counts.
    """
    identity: dict[str, Any] = {
        "content": cell_identity(content), "seed": job.seed, "strategy": job.strategy.value, "code": code,
    }  # fmt: skip
    if job.known is not None:
        identity["known"] = job.known.model_dump(mode="json")
    if own := own_code_of(content, job.strategy):
        identity["own"] = own
    return result_key(identity)


class ServiceLost(CrosspihError):
    """A trial ended because a service died: that says nothing about the method, so it is tried again."""


def run_trial(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """One trial in a worker's cell: `payload` has seed, strategy, record and the known pose of the hole; returns
    TrialFigures as plain data.
    """
    known = None if payload["known"] is None else PosePrior.model_validate(payload["known"])
    figures, _ = session.trial(payload["seed"], strategy_of(payload["strategy"]), payload["record"], known=known)
    if figures.failure == Failure.SERVICE_LOST.value:
        raise ServiceLost(f"seed {figures.seed}: {figures.failure_detail}")
    return figures.model_dump()


def trial_task(job: TrialJob, content: dict[str, Any], record: bool = False) -> CellTask:
    """The job as a task for a cell with this content."""
    where = "" if job.condition.name == "default" else f"{job.condition.name} "
    services = (*NEEDED, "recorder") if record else NEEDED
    known = None if job.known is None else job.known.model_dump(mode="json")
    payload = {"seed": job.seed, "strategy": job.strategy.value, "record": record, "known": known}
    return CellTask(f"{where}{job.strategy.value} {job.seed}", content, run_trial, payload, services)


def _kept(store: ResultStore | None, key: str) -> TrialFigures | None:
    row = None if store is None else store.get(key)
    try:
        return None if row is None else TrialFigures.model_validate(row)
    except ValidationError:
        return None


def run_trials(
    jobs: Sequence[TrialJob],
    *,
    cells: int | None = None,
    executor: ExecutorName = ExecutorName.LOCAL,
    ray_address: str | None = None,
    store: ResultStore | None = None,
    record: bool = False,
    on_done: Callable[[TrialJob, TrialFigures], object] = lambda job, figures: None,
    progress: CellsProgress | None = None,
    one_core_each: bool = False,
) -> list[TrialFigures]:
    """The figures of all jobs, in their order. Jobs that the store has are not done again (except recorded ones).

    `cells`: how many side by side, one per core when None; with `one_core_each` a local cell never leaves its core.
    `on_done` is called for each new trial as it ends. Raises TrialsEnded when a trial was lost twice, after all others
    are done; TrialsStopped on Ctrl-C; ConfigError.
    """
    base, code = base_cell_text(), code_version()
    contents = [cell_content(base, job.condition, job.peg) for job in jobs]
    keys = [trial_key(content, job, code) for content, job in zip(contents, jobs, strict=True)]
    done: dict[int, TrialFigures] = {}
    if not record:
        for index, key in enumerate(keys):
            if (kept := _kept(store, key)) is not None:
                done[index] = kept
    watch = SourceWatch()
    left = [index for index in range(len(jobs)) if index not in done]

    def on_result(position: int, result: dict[str, Any]) -> None:
        index = left[position]
        figures = TrialFigures.model_validate(result)
        job = jobs[index]
        # a trial with weights that were trained anew meanwhile is another trial
        if store is not None and watch.unchanged() and trial_key(contents[index], job, code) == keys[index]:
            store.put(
                keys[index], result, code=code, took_s=figures.wall_s, seed=job.seed, strategy=job.strategy.value,
                condition=job.condition.name, peg=job.peg,
            )  # fmt: skip
        done[index] = figures
        on_done(job, figures)

    def ended() -> list[tuple[TrialJob, TrialFigures]]:
        return [(jobs[index], done[index]) for index in sorted(done)]

    watcher = progress or CellsProgress(None)
    watcher.taken_over(len(jobs), len(done))
    if store is not None and (said := store.reuse_summary(code)):
        watcher.say(said)
    if not left:
        return [done[index] for index in range(len(jobs))]
    tasks = [trial_task(jobs[index], contents[index], record) for index in left]
    try:
        pool = open_executor(executor, cells, len(tasks), ray_address, one_core_each)
        try:
            with watcher:
                lost = run_in_cells(tasks, pool, on_result, watcher)
        finally:
            pool.close()
    except KeyboardInterrupt:
        raise TrialsStopped(f"stopped after {len(done)} of {len(jobs)} trials", ended()) from None
    if store is not None and not watch.unchanged():
        watcher.say("the sources changed meanwhile: what was made since is not kept", "yellow")
    if lost:
        first = next(iter(lost))
        raise TrialsEnded(
            f"{len(lost)} of {len(jobs)} trials could not be made, also when tried again; the first, "
            f"{tasks[first].label}: {lost[first]}",
            ended(),
        )
    return [done[index] for index in range(len(jobs))]
