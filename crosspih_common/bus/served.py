"""Waiting for the server of a command: a service that is being restarted, or all of them behind a lost router.

A query that finds nobody ends at once, as one does whose server died while it thought; and nobody can tell from outside
whether it was carried out. So before it is sent its server is waited for, as long as the caller's deadline and
SERVER_WAIT_S allow: what was never sent may be asked again, and a router that comes back within that time costs
patience, not the command.
"""

from __future__ import annotations

import threading
from typing import Any

import zenoh

# a service is started again within 2 to 5 s on an idle machine, a router within 1 s; on a busy one three times that
SERVER_WAIT_S = 15.0
# the router's first word on a key comes within some milliseconds: until then nobody seems to serve it
FIRST_WORD_S = 0.5


class ServedKeys:
    """Which keys somebody serves, as the router tells a session: one Zenoh querier a key that was asked about."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._changed = threading.Condition()
        self._queriers: dict[str, tuple[zenoh.Querier, zenoh.MatchingListener[None]]] = {}

    def wait(self, key: str, wait_s: float) -> bool:
        """Whether somebody serves the key, waiting for it up to `wait_s`. Raises zenoh.ZError on a closed session."""
        with self._changed:
            if key not in self._queriers:
                wait_s = max(wait_s, FIRST_WORD_S)
                made = self._session.declare_querier(key, target=zenoh.QueryTarget.BEST_MATCHING)
                self._queriers[key] = (made, made.declare_matching_listener(self._on_change))
            querier: Any = self._queriers[key][0]  # whose stub takes its status for a bool
            return self._changed.wait_for(lambda: bool(querier.matching_status.matching), max(wait_s, 0.0))

    def _on_change(self, status: zenoh.MatchingStatus) -> None:
        with self._changed:
            self._changed.notify_all()
