"""Ends a stack whose launcher died: a process of its own that reads the live process groups from a pipe.

Each line is ``+pgid`` or ``-pgid``. When the pipe closes, the launcher has gone; an orderly one has taken every group
off the list by then. What is left is asked to end, then killed. It works for whole groups and on every Unix; on Linux
the kernel has already sent each service SIGTERM (tethered_exec.py), which is not repeated, since a second SIGTERM may
cut an orderly end short. Run as a script, with the standard library only.
"""

import os
import signal
import sys
import time

_GRACE_S = 1.5
_POLL_S = 0.02


def _signal_group(pgid: int, number: int) -> bool:
    try:
        os.killpg(pgid, number)
    except (ProcessLookupError, PermissionError):
        return False
    return True


def main() -> None:
    """Keep the list until the pipe closes, then end what is on it."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    for line in sys.stdin:
        pgid = int(line[1:])
        if line.startswith("+"):
            groups.add(pgid)
        else:
            groups.discard(pgid)
    if not groups:
        return
    if not sys.platform.startswith("linux"):
        for pgid in groups:
            _signal_group(pgid, signal.SIGTERM)
    deadline_s = time.monotonic() + _GRACE_S
    while groups and time.monotonic() < deadline_s:
        groups = {pgid for pgid in groups if _signal_group(pgid, 0)}
        time.sleep(_POLL_S)
    for pgid in groups:
        _signal_group(pgid, signal.SIGKILL)


if __name__ == "__main__":
    main()
