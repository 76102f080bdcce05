"""Sends a running cell payloads that nobody should send, and records each command's answers and the services' state."""

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
# Commands whose accepted requests take long. After this many accepted ones no more fitting payloads are sent, and after
# twice as many (absurd ones can be valid too) only unreadable ones.
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
    """One command's payloads, one topic's, or the assembly afterwards: the answers, and the state of the services.

    `answers`: how often each refusal's code, `accepted` or `no answer`; `defects`: examples of wrong behaviour.
    Restarts and tracebacks are those of this part alone; memory is each service's at its end.
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
        """The defects of the cell, in words."""
        found = [f"{self.what}: {defect}" for defect in self.defects]
        found += [f"{self.what}: {service} started again, {count} times" for service, count in self.restarts.items()]
        return found + [
            f"{self.what}: {service} wrote {count} tracebacks" for service, count in self.tracebacks.items()
        ]


def parts() -> list[str]:
    """The parts of an attack in their order: every command, every topic, and an assembly."""
    return [
        *(command.path for command in commands()),
        *(topic.path for topic in topics() if not issubclass(topic.type, Image)),
        AFTERWARDS,
    ]


def attack(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """The work of a CellTask: `count` payloads of one part, drawn from `seed`. None is sent after the time `until`."""
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
    """Calibration and payload may have been changed by the commands before: both are made anew, as after any doubt."""
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
        # while it changes a calibration the service answers nobody else
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
                # the present lease, as its holder would name it
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
            # an earlier payload has lost the lease; a wrong lease is rightly refused
            if holder is not None and sort is Sort.FITTING and code == "no_lease":
                with contextlib.suppress(CrosspihError):
                    holder.take()
    return row


def _needs_holder(command: Command[Any, Any]) -> bool:
    return issubclass(command.request, Held)


def _put_all(session: Session, topic: Topic[Any], count: int, seed: int, until: float) -> AttackedPart:
    """Send a topic payloads that do not fit it: with the right label and others, from a stranger's session."""
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
    """The number of tracebacks in each service's log, as far as the launcher keeps it."""
    return {
        service: sum("Traceback (most recent" in line.text for line in tail.read())
        for service, tail in StateDirectory(session.cell.workcell.name).tails().items()
    }


def _more(before: dict[str, int], now: dict[str, int]) -> dict[str, int]:
    return {name: count - before.get(name, 0) for name, count in now.items() if count > before.get(name, 0)}


def _memory_mb(session: Session) -> dict[str, float]:
    """Resident memory of each service."""
    return {service: held.memory_mb for service, held in held_by_services(session.cell.workcell.name).items()}
