"""Becomes the command given, tied to the life of the launcher: ``tethered_exec.py <launcher pid> <word>...``.

Run as a script in the child, before the service: a ``preexec_fn`` would run Python between fork and exec, where
another thread's lock can hang it. On Linux the kernel then sends this process SIGTERM when the launcher dies, however
it dies; elsewhere the guard (guard.py) alone does that. Standard library only, started without site-packages.
"""

import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def _tie_to_parent(parent_pid: int) -> None:
    if not sys.platform.startswith("linux"):
        return
    try:
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0)
    except (ImportError, OSError, AttributeError):
        return  # A Python without ctypes, or a C library without prctl: the guard still ends the service.
    if os.getppid() != parent_pid:
        sys.exit("the launcher has gone")  # It died before the tie was made.


def main() -> None:
    """Tie, and exec; exit status 127 if there is no such command, 126 if it cannot be run (as a shell does)."""
    parent_pid, command = int(sys.argv[1]), sys.argv[2:]
    _tie_to_parent(parent_pid)
    # Python ignores these two at start, and exec would hand that on to the service.
    for name in ("SIGPIPE", "SIGXFSZ"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    try:
        os.execvp(command[0], command)
    except OSError as error:
        print(f"cannot run {command[0]!r}: {error.strerror}", file=sys.stderr, flush=True)
        sys.exit(127 if isinstance(error, FileNotFoundError) else 126)


if __name__ == "__main__":
    main()
