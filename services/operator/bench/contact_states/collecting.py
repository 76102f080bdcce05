"""Collects contacts in cells side by side until every state has enough; can be resumed."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console

from crosspih_common.config import CellFile, Workcell
from crosspih_common.config.cell import content_alone
from crosspih_common.provenance import ResultStore, cell_identity, code_version, result_key
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.contact_states.labels import TrueState, label_contacts
from services.operator.bench.contact_states.plan import (
    RANDOM,
    STATE_NAMES,
    Plan,
    lateral_stiffness_n_m,
    load_or_make,
    make_plan,
)
from services.operator.bench.contact_states.pushing import NEEDED, PushResult, PushTask, make_pushes

CHUNK = 20
ROUNDS = 7
MADE_BY = ("services.operator.bench.contact_states",)  # sources that count besides the cell's own code
SPARE = 4.0


@dataclass(frozen=True, slots=True)
class Contact:
    """One contact as the cell made it, with its true state."""

    stiffness_n_mm: float
    result: PushResult
    truth: TrueState


@dataclass(frozen=True, slots=True)
class CollectionPlan:
    """How much to collect: contacts per state in all, random pushes and the seed, over these stiffnesses of the arm."""

    each: int
    random: int
    seed: int
    stiffness_n_mm: tuple[float, ...]


def stiffness_condition(workcell: Workcell, stiffness_n_mm: float) -> Condition:
    """The cell whose arm holds the peg with this lateral stiffness at the rim; 0 leaves it unchanged."""
    if stiffness_n_mm == 0.0:
        return Condition(name="the cell's own")
    factor = stiffness_n_mm * 1e3 / lateral_stiffness_n_m(workcell)
    stiffness = [float(f"{value * factor:.6g}") for value in workcell.joint_stiffness_nm_rad]
    return Condition(name=f"{stiffness_n_mm:g} N/mm", overrides={"cell": {"joint_stiffness_nm_rad": stiffness}})


class Collection:
    """What is wanted, what there is, and what to push next."""

    def __init__(self, cell: CellFile, wanted: CollectionPlan, folder: Path, console: Console) -> None:
        self._cell, self._wanted, self._folder, self._console = cell, wanted, folder, console
        self._store = ResultStore(folder / "contacts.jsonl", "--folder")
        self._code = code_version(*MADE_BY)
        self._content: dict[float, dict[str, Any]] = {}
        self._identity: dict[float, dict[str, Any]] = {}
        self._plans: dict[float, Plan] = {}
        self._taper_start_m = cell.workcell.peg.shape().taper_start_m
        for stiffness in wanted.stiffness_n_mm:
            self._prepare(stiffness)

    def _prepare(self, stiffness: float) -> None:
        condition = stiffness_condition(self._cell.workcell, stiffness)
        content = cell_content(yaml.safe_dump(content_alone(self._cell), sort_keys=False), condition)
        workcell = Workcell.model_validate(content.get("cell") or {})
        friction = float(((content.get("hardware") or {}).get("simulated") or {}).get("friction_coefficient", 0.1))
        each = round(SPARE * self._quota())
        wanted = {"seed": self._wanted.seed, "each": each, "random": self._wanted.random}
        key = result_key({"cell": cell_identity(content), "code": self._code, **wanted})

        def make() -> Plan:
            self._console.print(f"choosing pose errors for {condition.name}", highlight=False)
            return make_plan(workcell, friction, stiffness, each, self._wanted.random, self._wanted.seed)

        self._content[stiffness], self._identity[stiffness] = content, cell_identity(content)
        self._plans[stiffness] = load_or_make(self._folder / f"plan-{key}.json", make)

    def _quota(self) -> int:
        return int(np.ceil(self._wanted.each / len(self._wanted.stiffness_n_mm)))

    def content(self, stiffness: float) -> dict[str, Any]:
        """The cell's file of a stiffness, as a mapping."""
        return self._content[stiffness]

    def plan(self, stiffness: float) -> Plan:
        """The plan of a stiffness."""
        return self._plans[stiffness]

    def contacts(self) -> list[Contact]:
        """All pushes so far that touched something, in the order of the plan."""
        found = []
        for stiffness, task in self._all():
            kept = self._store.get(self._key(stiffness, task))
            if kept is not None:
                result = PushResult.model_validate(kept)
                if result.failure is None:
                    rows = np.reshape(np.asarray(result.contacts, dtype=float), (-1, 6))
                    found.append(
                        Contact(stiffness, result, label_contacts(rows[:, :3], rows[:, 3:], self._taper_start_m))
                    )
        return found

    def _all(self) -> Iterator[tuple[float, PushTask]]:
        for stiffness, plan in self._plans.items():
            for number, target in enumerate((*STATE_NAMES, RANDOM)):
                for index, push in enumerate(plan.pushes[target]):
                    seed = self._wanted.seed + 1_000_000 * round(stiffness) + 10_000 * number + index
                    yield stiffness, PushTask(target=target, index=index, seed=seed, push=push)

    def _key(self, stiffness: float, task: PushTask) -> str:
        cell = self._identity[stiffness]
        return result_key({"cell": cell, "task": task.model_dump(mode="json"), "code": self._code})

    def _next(self, part: float) -> list[tuple[float, PushTask]]:
        """The next pushes: for each stiffness as many of each state as are missing from this part of its share."""
        made: Counter[tuple[float, str]] = Counter()
        total: Counter[str] = Counter()
        for contact in self.contacts():
            made[contact.stiffness_n_mm, contact.truth.name] += 1
            total[contact.truth.name] += 1
        todo: list[tuple[float, PushTask]] = []
        taken: Counter[tuple[float, str]] = Counter()
        for stiffness, task in self._all():
            if self._store.get(self._key(stiffness, task)) is not None:
                continue
            if task.target == RANDOM:
                due = task.index < part * self._wanted.random
            else:
                short = np.ceil(part * self._quota()) - made[stiffness, task.target]
                due = taken[stiffness, task.target] < short and total[task.target] < self._wanted.each
            if due:
                taken[stiffness, task.target] += 1
                todo.append((stiffness, task))
        return todo if todo or part < 1.0 else self._fill_up(total)

    def _fill_up(self, total: Counter[str]) -> list[tuple[float, PushTask]]:
        """States that one stiffness cannot produce often enough are produced with the others."""
        todo: list[tuple[float, PushTask]] = []
        taken: Counter[str] = Counter()
        for stiffness, task in self._all():
            short = 1.3 * (self._wanted.each - total[task.target])
            open_still = self._store.get(self._key(stiffness, task)) is None
            if task.target != RANDOM and taken[task.target] < short and open_still:
                taken[task.target] += 1
                todo.append((stiffness, task))
        return todo

    def collect(self, cells: int | None, executor: ExecutorName, ray_address: str | None) -> list[str]:
        """Push until every state has enough, in at most a few rounds. Returns the lost tasks, in words."""
        lost: list[str] = []
        self.contacts()
        if said := self._store.reuse_summary(self._code):
            self._console.print(said, highlight=False)
        for number in range(ROUNDS):
            # first half of everything, so that an early stop leaves something of each state
            part = 0.5 if number == 0 else 1.0
            todo = self._next(part)
            if not todo and part == 1.0:
                break
            lost += self._round(number, todo, cells, executor, ray_address)
        self._store.close()
        return lost

    def _round(
        self, number: int, todo: list[tuple[float, PushTask]], cells: int | None, executor: ExecutorName,
        ray_address: str | None,
    ) -> list[str]:  # fmt: skip
        if not todo:
            return []
        chunks: list[tuple[float, tuple[PushTask, ...]]] = []
        for stiffness in self._plans:
            tasks = [task for at, task in todo if at == stiffness]
            chunks += [(stiffness, tuple(tasks[i : i + CHUNK])) for i in range(0, len(tasks), CHUNK)]
        jobs = [
            CellTask(
                f"{stiffness:g} N/mm {tasks[0].target}", self._content[stiffness], make_pushes, tasks, services=NEEDED
            )
            for stiffness, tasks in chunks
        ]
        began_s = time.monotonic()

        def done(index: int, results: list[dict[str, Any]]) -> None:
            stiffness, tasks = chunks[index]
            nonlocal began_s
            took_s, began_s = (time.monotonic() - began_s) / len(tasks), time.monotonic()
            for task, result in zip(tasks, results, strict=True):
                self._store.put(
                    self._key(stiffness, task), {**result, "code": self._code}, code=self._code,
                    took_s=round(took_s, 3), stiffness_n_mm=stiffness,
                )  # fmt: skip

        engine = open_executor(executor, cells, len(jobs), ray_address)
        try:
            with CellsProgress(self._console, f"round {number + 1}: {len(todo)} pushes, {CHUNK} a step") as progress:
                progress.taken_over(len(jobs), 0)
                return list(run_in_cells(jobs, engine, done, progress).values())
        finally:
            engine.close()
