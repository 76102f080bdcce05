"""How a process with a Zenoh session ends once all is closed."""

from __future__ import annotations

import atexit
import os
import sys
import threading
from typing import NoReturn

from crosspih_common.bus.closing import close_all


def end_process(status: int) -> NoReturn:
    """End this process with that exit status, as `sys.exit` does in the main thread, but for Python's own dismantling.

    A thread of Zenoh that is about to call Python while the interpreter is dismantled is ended by it in the middle of
    Zenoh's code, and that aborts the process ("FATAL: exception not rethrown", status -6: 1 of 24 ends on a machine
    with 25 busy processes a core). Sessions that were left open are closed, what was registered for the end is done,
    threads that are to be waited for are.
    """
    close_all()  # first: Zenoh's callback threads are among those that are waited for
    for thread in threading.enumerate():
        if thread is not threading.main_thread() and not thread.daemon:
            thread.join()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # nobody reads any more
            continue
    os._exit(status)
