"""`crosspih pause`, `resume` and `stop`: a say in the assembly that runs, whoever asked for it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from crosspih_common.keys import ABORT, PAUSE
from crosspih_common.messages import AbortAssembly, PauseAssembly
from services.operator.assembly.session import Session
from services.operator.bench.options import AsJson, told

ANSWER_S = 5.0
LOOK_S = 2.0
NOTHING = "nothing runs"


@contextmanager
def _running_stack(console: Console) -> Iterator[Session]:
    """The running stack; nothing is started for these commands, for then nothing would run in it."""
    with told(console), Session(connect_timeout_s=LOOK_S) as session:
        session.wait_for_services(LOOK_S, ("planning",))
        yield session


def _pause(paused: bool, as_json: bool, said: str) -> None:
    console = Console(stderr=as_json)
    with _running_stack(console) as session:
        accepted = session.bus.call(PAUSE, PauseAssembly(paused=paused), ANSWER_S)
        if as_json:
            sys.stdout.write(accepted.model_dump_json() + "\n")
        else:
            console.print(said if accepted.was_running else NOTHING, highlight=False)


def pause(as_json: AsJson = False) -> None:
    """Hold the running assembly: the motion under way is finished, and the arm then stays where it is."""
    _pause(True, as_json, "paused after the motion under way; `crosspih resume` goes on, `crosspih stop` ends it")


def resume(as_json: AsJson = False) -> None:
    """Let a paused assembly go on."""
    _pause(False, as_json, "goes on")


def stop(as_json: AsJson = False) -> None:
    """Stop the arm at once and end the running assembly; the peg is then backed off."""
    console = Console(stderr=as_json)
    with _running_stack(console) as session:
        accepted = session.bus.call(ABORT, AbortAssembly(), ANSWER_S)
        if as_json:
            sys.stdout.write(accepted.model_dump_json() + "\n")
        else:
            said = "the arm is stopped, and the peg is being backed off"
            console.print(said if accepted.was_running else NOTHING, highlight=False)
