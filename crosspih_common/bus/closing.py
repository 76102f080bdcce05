"""Every Zenoh session of this process is closed before the interpreter ends: one left open hangs it at exit."""

from __future__ import annotations

import atexit
import threading
import weakref

from crosspih_common.bus.transport import Closeable

CLOSE_S = 5.0  # a session closes in milliseconds

_open: weakref.WeakSet[Closeable] = weakref.WeakSet()


def close_at_exit(transport: Closeable) -> None:
    """Close a transport when the process ends, unless it was closed before."""
    _open.add(transport)


def _close_all() -> None:
    for transport in list(_open):
        transport.close()


def close_all() -> None:
    """Close every session of this process that is open; waits CLOSE_S at most."""
    closer = threading.Thread(target=_close_all, name="zenoh-close", daemon=True)
    closer.start()
    closer.join(CLOSE_S)


def _close_when_main_ends() -> None:
    # Zenoh's callback threads are joined before atexit functions run, and they end only with their session: so the
    # sessions are closed by a daemon that waits for the main thread.
    threading.main_thread().join()
    _close_all()


def _wait_until_closed() -> None:
    if not threading.main_thread().is_alive():  # it is alive when `end_process` calls this, which has closed all
        _closer.join(CLOSE_S)


_closer = threading.Thread(target=_close_when_main_ends, name="zenoh-close", daemon=True)
_closer.start()
# the interpreter must not finish while a session is still closing
atexit.register(_wait_until_closed)
