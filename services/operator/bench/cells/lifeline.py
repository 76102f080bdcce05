"""Stops a worker's stack when the worker is gone: `python -m services.operator.bench.cells.lifeline PROJECT FOLDER`.

Standard input is a pipe that the worker holds open as long as it lives, however it ends.
"""

from __future__ import annotations

import contextlib
import shutil
import signal
import sys
from pathlib import Path


def main(project: str, folder: Path) -> None:
    """Wait for the end of the pipe, then stop the stack, if it still runs, and remove its folder."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    sys.stdin.buffer.read()
    if not folder.exists():
        return
    # imported only now: a helper that usually does nothing should cost nothing
    from deploy.launcher import LauncherError, stop_stack

    with contextlib.suppress(LauncherError, OSError):
        stop_stack(project, folder / "run")
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
