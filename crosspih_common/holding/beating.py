"""The process that beats for its parent: `python -m crosspih_common.holding.beating ENDPOINT CELL SERVICE PARENT`.

One JSON object a line on standard input, {"take": purpose} or {"give": true}, each answered by one on standard output.
It ends when its input does: with the parent.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import Any

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import BusError, CommandRefused
from crosspih_common.holding.heart import Heart
from crosspih_common.service.ending import end_process
from crosspih_common.service.urgency import be_urgent

# process states: stopped by a signal, stopped by a debugger, zombie, dead
SILENT_STATES = frozenset("TtZX")


def runs(pid: int) -> bool:
    """Whether a process can run: it is there, and not stopped. False without one, and for one that is only a zombie."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as stat:
            state = stat.read().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        if os.path.isdir("/proc/self"):
            return False
        state = _state_by_ps(pid)
    return bool(state) and state[0] not in SILENT_STATES


def _state_by_ps(pid: int) -> str:
    """For systems without /proc; empty without such a process."""
    told = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False)
    return told.stdout.strip()


def answer(heart: Heart, what: dict[str, Any]) -> dict[str, Any]:
    """Carry out one line of the input."""
    try:
        if "take" in what:
            return {"granted": heart.take(what["take"]).model_dump()}
        return {"was_held": heart.give()}
    except CommandRefused as refusal:
        return {"refused": refusal.code, "text": refusal.text}
    except BusError as error:
        return {"error": type(error).__name__, "text": str(error)}


def main(endpoint: str, cell: str, service: str, parent: int) -> int:
    """Beat until the input ends."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the parent decides when the lease is given back
    be_urgent()  # before Zenoh starts its threads
    with Bus(open_zenoh(endpoint, service=service), cell, service, claim=False) as bus:
        heart = Heart(bus, lambda: os.getppid() == parent and runs(parent))
        print("{}", flush=True)
        for line in sys.stdin:
            print(json.dumps(answer(heart, json.loads(line))), flush=True)
        heart.close()
    return 0


if __name__ == "__main__":
    end_process(main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])))
