"""`crosspih pause`, `resume` and `stop`: act on the running assembly, whoever started it."""

from __future__ import annotations

import json
import sys

from rich.console import Console

from services.operator.assembly.stack import LOOK_S, running_session
from services.operator.bench.options import AsJson, errors_shown

NEEDED = ("planning",)
NOTHING = "nothing runs"


def _say(console: Console, as_json: bool, said: str, was_running: bool, **more: bool) -> None:
    if as_json:
        sys.stdout.write(json.dumps({"was_running": was_running, **more}) + "\n")
    else:
        console.print(said if was_running else NOTHING, highlight=False)


def pause(as_json: AsJson = False) -> None:
    """Hold the running assembly: the motion under way is finished, and the arm then stays where it is."""
    console = Console(stderr=as_json)
    with errors_shown(console), running_session(NEEDED, LOOK_S) as session:
        held = session.pause()
    said = "paused after the motion under way; `crosspih resume` goes on, `crosspih stop` ends it"
    _say(console, as_json, said, held, paused=held)


def resume(as_json: AsJson = False) -> None:
    """Let a paused assembly go on."""
    console = Console(stderr=as_json)
    with errors_shown(console), running_session(NEEDED, LOOK_S) as session:
        was_running = session.resume()
    _say(console, as_json, "goes on", was_running, paused=False)


def stop(as_json: AsJson = False) -> None:
    """Stop the arm at once and end the running assembly; the peg is then backed off."""
    console = Console(stderr=as_json)
    with errors_shown(console), running_session(NEEDED, LOOK_S) as session:
        was_running = session.abort()
    _say(console, as_json, "the arm is stopped, and the peg is being backed off", was_running)
