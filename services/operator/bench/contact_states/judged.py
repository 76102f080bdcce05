"""The contacts of a collection classified over the bus, by both classifiers, in the cell that made them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from crosspih_common.keys import CLASSIFY
from crosspih_common.messages import ClassifyContacts, ContactClassifier, ContactState
from crosspih_common.provenance import ResultStore, cell_identity, code_version, result_key
from services.operator.assembly.session import Session
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.pool import ExecutorName, open_executor, run_in_cells
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.contact_states.collecting import MADE_BY, Collection, Contact
from services.operator.bench.contact_states.labels import NONE

CHUNK = 200
CALL = 25
DEADLINE_S = 60.0
CLASSIFIERS = (ContactClassifier.RULE, ContactClassifier.LIKELIHOOD)


@dataclass(frozen=True, slots=True)
class StateVerdict:
    """The answer of a classifier: a state's name or "none", the confidence, and the reason for none."""

    name: str
    confidence: float
    reason: str

    @classmethod
    def of(cls, state: ContactState) -> StateVerdict:
        """From the message."""
        return cls(state.case or NONE, state.confidence, state.reason)


@dataclass(frozen=True, slots=True)
class Judged:
    """A contact, its true state, and the answer of each classifier."""

    contact: Contact
    verdicts: dict[ContactClassifier, StateVerdict]

    def right(self, classifier: ContactClassifier) -> bool:
        """Whether the classifier named the true state, or none where it is none."""
        return self.verdicts[classifier].name == self.contact.truth.name


def judge_wrenches(session: Session, wrenches: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]) -> list[Any]:
    """For each (wrench, sd): [[name, confidence, reason] by each of CLASSIFIERS]."""
    found: list[list[list[Any]]] = [[] for _ in wrenches]
    for classifier in CLASSIFIERS:
        for begin in range(0, len(wrenches), CALL):
            part = wrenches[begin : begin + CALL]
            states = session.bus.call(
                CLASSIFY,
                ClassifyContacts(
                    wrenches=tuple(wrench for wrench, _ in part),
                    wrench_sds=tuple(sd for _, sd in part),
                    classifier=classifier,
                ),
                DEADLINE_S,
            ).states
            for index, state in enumerate(states):
                verdict = StateVerdict.of(state)
                found[begin + index].append([verdict.name, verdict.confidence, verdict.reason])
    return found


def judge(collection: Collection, folder: Path, cells: int | None, console: Console) -> list[Judged]:
    """All contacts of a collection, classified by the code that runs here; earlier answers of the same code are taken
    over.
    """
    contacts = collection.contacts()
    version = code_version(*MADE_BY)
    stiffnesses = dict.fromkeys(contact.stiffness_n_mm for contact in contacts)
    identities = {stiffness: cell_identity(collection.content(stiffness)) for stiffness in stiffnesses}
    with ResultStore(folder / "judged.jsonl", "--folder") as store:
        keys = [
            result_key({
                "code": version, "cell": identities[contact.stiffness_n_mm], "wrench": list(contact.result.wrench),
                "sd": list(contact.result.wrench_sd),
            })
            for contact in contacts
        ]  # fmt: skip
        jobs, members = [], []
        for stiffness in stiffnesses:
            open_ones = [
                index
                for index, contact in enumerate(contacts)
                if contact.stiffness_n_mm == stiffness and store.get(keys[index]) is None
            ]
            for begin in range(0, len(open_ones), CHUNK):
                chosen = open_ones[begin : begin + CHUNK]
                payload = tuple((contacts[index].result.wrench, contacts[index].result.wrench_sd) for index in chosen)
                content = collection.content(stiffness)
                label = f"judging, {stiffness:g} N/mm"
                services = ("hardware", "force_torque")
                jobs.append(CellTask(label, content, judge_wrenches, payload, services=services, calibrate=False))
                members.append(chosen)

        def done(job: int, results: list[Any]) -> None:
            for index, verdicts in zip(members[job], results, strict=True):
                store.put(keys[index], {"verdicts": verdicts}, code=version)

        if jobs:
            engine = open_executor(ExecutorName.LOCAL, cells, len(jobs))
            try:
                with CellsProgress(console, "judging") as progress:
                    progress.taken_over(len(jobs), 0)
                    run_in_cells(jobs, engine, done, progress)
            finally:
                engine.close()
        judged = []
        for contact, key in zip(contacts, keys, strict=True):
            kept = store.get(key)
            if kept is not None:
                verdicts = {
                    classifier: StateVerdict(*row)
                    for classifier, row in zip(CLASSIFIERS, kept["verdicts"], strict=True)
                }
                judged.append(Judged(contact, verdicts))
        return judged
