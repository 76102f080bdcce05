"""A running cell under payloads that nobody should send: what each command answers, and how the services fare."""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from pathlib import Path
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
    author_key,
    commands,
    topics,
)
from crosspih_common.messages import Dwell, Image, ResetCell, Strategy
from crosspih_common.messages.motion import Held
from deploy.launcher import StateDirectory
from services.operator.bench.fuzz.payloads import PayloadMaker, Sort
from services.operator.session import NEEDED, Session, endpoint

DEADLINE_S = 120.0
# what each accepted request of takes long: of these as many that fit, and all the others that do not
LONG = {
    ASSEMBLE.path: 3, CALIBRATE_FT.path: 1, WITHDRAW.path: 10, RESET.path: 40, LOCATE.path: 5, CAPTURE.path: 10,
    FOLLOW.path: 60, DWELL.path: 20,
}  # fmt: skip
SORTS = (Sort.FITTING, Sort.FITTING, Sort.MISFIT, Sort.BROKEN)
INTERNAL = "internal"
NOTHING = "no answer"


class Answered(BaseModel):
    """What one command answered: refusal codes, `accepted`, `no answer`; and examples of what must not be."""

    command: str
    answers: Counter[str] = Field(default_factory=Counter)
    defects: list[str] = Field(default_factory=list)


class Attacked(BaseModel):
    """All commands, the samples put on topics, and the services before and after."""

    commands: list[Answered] = []
    samples: int = 0
    restarts: dict[str, int] = {}
    grown_mb: dict[str, float] = {}
    tracebacks: dict[str, int] = {}
    inserted: bool | None = None
    failure: str = ""

    @property
    def defects(self) -> list[str]:
        """What speaks against the cell, in words."""
        found = [f"{row.command}: {what}" for row in self.commands for what in row.defects]
        found += [f"{service} was started again {count} times" for service, count in self.restarts.items() if count]
        found += [f"{service} wrote {count} tracebacks" for service, count in self.tracebacks.items() if count]
        return found + ([] if self.inserted else [f"the assembly afterwards: {self.failure or 'not inserted'}"])


def attack(session: Session, payload: dict[str, int]) -> dict[str, Any]:
    """The work of a CellTask: `count` payloads for each command and each topic, drawn from `seed`."""
    count, seed = payload["count"], payload["seed"]
    done = Attacked()
    before = _memory_mb(session)
    for command in commands():
        done.commands.append(_ask_all(session, command, count, seed))
    done.samples = _put_all(session, count, seed)
    done.restarts = {row.service: row.restarts for row in _rows(session)}
    done.grown_mb = {name: round(now - before.get(name, now), 1) for name, now in _memory_mb(session).items()}
    done.tracebacks = {
        service: sum("Traceback (most recent" in line.text for line in tail.read())
        for service, tail in StateDirectory(session.cell.workcell.name).tails().items()
    }
    # whatever was asked may have left another calibration or payload: both are made anew, as after any doubt
    try:
        session.wait_for_services(DEADLINE_S, NEEDED)
        session.reset(ResetCell(seed=0))
        session.calibrate_ft(0.25)
        figures, _ = session.trial(1000, Strategy.FUSED, record=False)
        done.inserted, done.failure = figures.inserted, figures.failure_detail
    except CrosspihError as error:
        done.inserted, done.failure = False, str(error)
    return done.model_dump(mode="json")


def _ask_all(session: Session, command: Command[Any, Any], count: int, seed: int) -> Answered:
    maker, row = PayloadMaker(command.request.model_json_schema(), seed), Answered(command=command.path)
    fitting = LONG.get(command.path, count)
    with open_zenoh(endpoint()) as transport, contextlib.ExitStack() as held:
        # a command that changes a calibration answers nobody else
        author = author_key(session.cell.workcell.name, command.callers[0], PROCESS, transport.author)
        transport.claim(author)
        holder = held.enter_context(hold_arm(session.bus, "fuzzing")) if _needs_holder(command) else None
        for index in range(count):
            sort = SORTS[index % len(SORTS)]
            if sort is Sort.FITTING and fitting <= 0:
                sort = Sort.MISFIT
            fitting -= sort is Sort.FITTING
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
            row.answers[code if answer.is_error else "accepted"] += 1
            if answer.is_error and (code == INTERNAL or not text):
                row.defects.append(f"{code}: {text[:200]} to {sent[:1500]!r}")
            if holder is not None and code == "no_lease":
                with contextlib.suppress(CrosspihError):
                    holder.take()
    return row


def _needs_holder(command: Command[Any, Any]) -> bool:
    return issubclass(command.request, Held)


def _put_all(session: Session, count: int, seed: int) -> int:
    """Put on every topic what does not fit it: of the right label and others, from a stranger's session."""
    sent = 0
    with open_zenoh(endpoint()) as transport:
        for topic in topics():
            if issubclass(topic.type, Image):
                continue
            maker = PayloadMaker(topic.type.model_json_schema(), seed)
            sender = transport.sender(topic.key(session.cell.workcell.name, "planning"), recover=False, history=0)
            for index in range(count):
                label = label_with_seq(topic.type, index) if index % 3 else f"crosspih.Nothing/1 {'9' * 30}"
                sender.put(maker.payload(Sort.BROKEN if index % 2 else Sort.MISFIT), label)
                sent += 1
            sender.close()
    return sent


def _rows(session: Session) -> Any:
    state = StateDirectory(session.cell.workcell.name).read()
    if state is None:
        raise NoService("the launcher's state cannot be read: is the stack still up?")
    return state.services


def _memory_mb(session: Session) -> dict[str, float]:
    """Resident memory of each service."""
    found = {}
    for row in _rows(session):
        with contextlib.suppress(OSError, StopIteration):
            lines = Path(f"/proc/{row.pid}/status").read_text().splitlines()
            found[row.service] = int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024
    return found
