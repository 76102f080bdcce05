"""A process that ends by `end_process` has done all that it was to do at its end, whatever its other threads are at."""

from __future__ import annotations

import subprocess
import sys

BUSY = """
import atexit, sys, threading, time
from crosspih_common.service.ending import end_process
begun = threading.Event()
def writes():
    begun.wait()
    sys.stdout.write("written ")
def never():
    while True:
        time.sleep(0.001)
threading.Thread(target=writes).start()
threading.Thread(target=never, daemon=True).start()
atexit.register(lambda: sys.stdout.write("and told"))
begun.set()
end_process(3)
"""


def test_what_is_to_be_done_at_the_end_is_done() -> None:
    ended = subprocess.run([sys.executable, "-c", BUSY], capture_output=True, text=True, timeout=60.0, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (3, "written and told", "")
