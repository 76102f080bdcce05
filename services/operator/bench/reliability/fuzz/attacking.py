"""A running cell under payloads that nobody should send: what each command answers, and how the services fare."""

from __future__ import annotations

import contextlib
import json
import time
from collections import Counter
from typing import Any

from pydantic import BaseModel, Field

from crosspih_common.bus import open_zenoh
from crosspih_common.bus.authors import PROCESS
from crosspih_common.bus.codec import label_of, label_with_seq
from crosspih_common.errors import CrosspihError, NoService
from crosspih_common.holding import hold_arm
from crosspih_common.keys import (
    ASSEMBLE,
    CALIBRATE_FT,
    CAPTURE,
    DWELL,
    FOLLOW,
    LOCATE,
    RESET,
    WITHDRAW,
    Command,
    Topic,
    author_key,
    commands,
    topics,
)
from crosspih_common.messages import Dwell, Image, ResetCell, Strategy
from crosspih_common.messages.motion import Held
from deploy.launcher import StateDirectory
from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.cells.processes import held_by_services, restarts_of
from services.operator.bench.reliability.fuzz.payloads import PayloadMaker, Sort
from services.operator.cell.which_cell import endpoint

DEADLINE_S = 120.0
# What each accepted request of takes long: no more are sent that fit once so many were accepted, and once twice as many
# were (also absurd ones can be sound) only what cannot be read.
LONG = {
    ASSEMBLE.path: 3, CALIBRATE_FT.path: 1, WITHDRAW.path: 10, RESET.path: 40, LOCATE.path: 5, CAPTURE.path: 10,
    FOLLOW.path: 60, DWELL.path: 20,
}  # fmt: skip
SORTS = (Sort.FITTING, Sort.FITTING, Sort.MISFIT, Sort.BROKEN)
ACCEPTED = "accepted"
INTERNAL = "internal"
NOTHING = "no answer"
AFTERWARDS = "an assembly afterwards"


class AttackedPart(BaseModel):
    """One command's payloads, one topic's, or the assembly afterwards: what was answered, and how the services fared.

    `answers`: how often each refusal's code, `accepted` or `no answer`; `defects`: examples of what must not be.
    Restarts and tracebacks are those of this part alone, memory is what each service had at its end.
    """

    what: str
    answers: Counter[str] = Field(default_factory=Counter)
    samples: int = 0
    defects: list[str] = Field(default_factory=list)
    restarts: dict[str, int] = {}
    tracebacks: dict[str, int] = {}
    memory_mb: dict[str, float] = {}

    @property
    def told(self) -> list[str]:
        """What speaks against the cell, in words."""
        found = [f"{self.what}: {defect}" for defect in self.defects]
        found += [f"{self.what}: {service} started again, {count} times" for service, count in self.restarts.items()]
        return found + [
            f"{self.what}: {service} wrote {count} tracebacks" for service, count in self.tracebacks.items()
        ]


def parts() -> list[str]:
    """What an attack is made of, in its order: every command, every topic, and an assembly."""
    return [
        *(command.path for command in commands()),
        *(topic.path for topic in topics() if not issubclass(topic.type, Image)),
        AFTERWARDS,
    ]


def attack(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """The work of a CellTask: `count` payloads of one part, drawn from `seed`. No more are sent once it is `until`."""
    what, count, seed, until = payload["part"], payload["count"], payload["seed"], payload["until"]
    before = _restarts(session), _tracebacks(session)
    by_path = {command.path: command for command in commands()}
    if what == AFTERWARDS:
        part = _assemble(session)
    elif what in by_path:
        part = _ask_all(session, by_path[what], count, seed, until)
    else:
        part = _put_all(session, next(topic for topic in topics() if topic.path == what), count, seed, until)
    part.restarts = _more(before[0], _restarts(session))
    part.tracebacks = _more(before[1], _tracebacks(session))
    part.memory_mb = _memory_mb(session)
    return part.model_dump(mode="json")


def _assemble(session: Session) -> AttackedPart:
    """Whatever was asked may have left another calibration or payload: both are made anew, as after any doubt."""
    part = AttackedPart(what=AFTERWARDS)
    try:
        session.wait_for_services(DEADLINE_S, NEEDED)
        session.new_trial(ResetCell(seed=0))
        session.calibrate_ft(0.25)
        figures, _ = session.trial(1000, Strategy.FUSED, record=False)
        part.answers["inserted" if figures.inserted else "not inserted"] += 1
        part.defects += [] if figures.inserted else [f"not inserted: {figures.failure_detail}"]
    except CrosspihError as error:
        part.defects.append(str(error))
    return part


def _ask_all(session: Session, command: Command[Any, Any], count: int, seed: int, until: float) -> AttackedPart:
    maker = PayloadMaker(command.request.model_json_schema(), f"{seed} {command.path}")
    row = AttackedPart(what=command.path)
    enough = LONG.get(command.path, count)
    with open_zenoh(endpoint()) as transport, contextlib.ExitStack() as held:
        # a command that changes a calibration answers nobody else
        author = author_key(session.cell.workcell.name, command.callers[0], PROCESS, transport.author)
        transport.claim(author)
        holder = held.enter_context(hold_arm(session.bus, "fuzzing")) if _needs_holder(command) else None
        for index in range(count):
            if time.time() > until:
                break
            sort = SORTS[index % len(SORTS)]
            if sort is Sort.FITTING and row.answers[ACCEPTED] >= enough:
                sort = Sort.MISFIT
            if row.answers[ACCEPTED] >= 2 * enough:
                sort = Sort.BROKEN
            sent = maker.payload(sort)
            if holder is not None and sort is Sort.FITTING:
                # the lease of now, as its holder would name it
                lease = holder.named(Dwell(duration_s=0.1)).lease
                sent = json.dumps({**json.loads(sent), "lease": lease}).encode()
            try:
                answer = transport.query(
                    command.key(session.cell.workcell.name), sent, label_of(command.request), DEADLINE_S
                )
            except NoService:
                row.answers[NOTHING] += 1
                row.defects.append(f"no answer to {sent[:200]!r}")
                continue
            except CrosspihError as error:
                row.answers[type(error).__name__] += 1
                row.defects.append(f"{error} to {sent[:200]!r}")
                continue
            code, _, text = answer.payload.decode(errors="replace").partition("\n")
            row.answers[code if answer.is_error else ACCEPTED] += 1
            if answer.is_error and (code == INTERNAL or not text):
                row.defects.append(f"{code}: {text[:200]} to {sent[:1500]!r}")
            # what came before has cost it the lease; of the others a lease that is wrong is refused rightly
            if holder is not None and sort is Sort.FITTING and code == "no_lease":
                with contextlib.suppress(CrosspihError):
                    holder.take()
    return row


def _needs_holder(command: Command[Any, Any]) -> bool:
    return issubclass(command.request, Held)


def _put_all(session: Session, topic: Topic[Any], count: int, seed: int, until: float) -> AttackedPart:
    """Put on a topic what does not fit it: of the right label and others, from a stranger's session."""
    part, maker = AttackedPart(what=topic.path), PayloadMaker(topic.type.model_json_schema(), f"{seed} {topic.path}")
    with open_zenoh(endpoint()) as transport:
        sender = transport.sender(topic.key(session.cell.workcell.name, "planning"), recover=False, history=0)
        for index in range(count):
            if time.time() > until:
                break
            label = label_with_seq(topic.type, index) if index % 3 else f"crosspih.Nothing/1 {'9' * 30}"
            sender.put(maker.payload(Sort.BROKEN if index % 2 else Sort.MISFIT), label)
            part.samples += 1
        sender.close()
    return part


def _restarts(session: Session) -> dict[str, int]:
    return restarts_of(session.cell.workcell.name)


def _tracebacks(session: Session) -> dict[str, int]:
    """How many each service's log has, of what the launcher keeps of it."""
    return {
        service: sum("Traceback (most recent" in line.text for line in tail.read())
        for service, tail in StateDirectory(session.cell.workcell.name).tails().items()
    }


def _more(before: dict[str, int], now: dict[str, int]) -> dict[str, int]:
    return {name: count - before.get(name, 0) for name, count in now.items() if count > before.get(name, 0)}


def _memory_mb(session: Session) -> dict[str, float]:
    """Resident memory of each service."""
    return {service: held.memory_mb for service, held in held_by_services(session.cell.workcell.name).items()}
