"""Keeps the state file up to date on a disk that may be full: what cannot be written is written as soon as it can be.

A stack whose state cannot be written runs on; `crosspih ps` shows what was written last. That is said once, and again
when the file is up to date.
"""

import asyncio
from collections.abc import Callable

from deploy.launcher.state import StackState, StateDirectory

RETRY_S = 1.0


class StateKeeper:
    """Writes states within a running event loop; the newest that could not be written is tried again every RETRY_S."""

    def __init__(self, directory: StateDirectory, say: Callable[[str], None], retry_s: float = RETRY_S) -> None:
        self._directory, self._say, self._retry_s = directory, say, retry_s
        self._unwritten: StackState | None = None
        self._retry: asyncio.TimerHandle | None = None

    def keep(self, state: StackState) -> None:
        """Write the state now, or when the disk takes it; never raises for what a disk can do."""
        was_behind = self._unwritten is not None
        try:
            self._directory.write(state)
        except OSError as error:
            self._unwritten = state
            if not was_behind:
                self._say(
                    f"the state cannot be written ({error.strerror or error}: {self._directory.path}); the stack goes "
                    "on, and crosspih ps shows how it was"
                )
            if self._retry is None:
                self._retry = asyncio.get_running_loop().call_later(self._retry_s, self._try_again)
            return
        self._unwritten = None
        if was_behind:
            self._say("the state is written again")

    def close(self) -> None:
        """Try no more."""
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None

    def _try_again(self) -> None:
        self._retry = None
        if self._unwritten is not None:
            self.keep(self._unwritten)
