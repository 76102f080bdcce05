"""Waiting for the server of a command: a service that is being restarted, or all of them behind a lost router.

A query without a server ends at once, and so does one whose server died during the work. The caller cannot tell these
two apart, so it does not know whether the command was carried out. Therefore the bus first waits for the server, as
long as the caller's deadline and SERVER_WAIT_S allow. A command that was never sent can be sent again, and a router
that returns within that time delays the command but does not lose it.
"""

from __future__ import annotations

import threading
from typing import Any

import zenoh

# a service is started again within 2 to 5 s on an idle machine, a router within 1 s; on a busy one three times that
SERVER_WAIT_S = 15.0
# the router's first answer about a key takes some milliseconds: until then the key seems to have no server
FIRST_WORD_S = 0.5


class ServedKeys:
    """Which keys have a server, by the router's notifications: one Zenoh querier for each key in question."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._changed = threading.Condition()
        self._queriers: dict[str, tuple[zenoh.Querier, zenoh.MatchingListener[None]]] = {}

    def wait(self, key: str, wait_s: float) -> bool:
        """Whether the key has a server, waiting for one up to `wait_s`. Raises zenoh.ZError on a closed session."""
        with self._changed:
            if key not in self._queriers:
                wait_s = max(wait_s, FIRST_WORD_S)
                made = self._session.declare_querier(key, target=zenoh.QueryTarget.BEST_MATCHING)
                self._queriers[key] = (made, made.declare_matching_listener(self._on_change))
            querier: Any = self._queriers[key][0]  # Any: the type stub says wrongly that its status is a bool
            return self._changed.wait_for(lambda: bool(querier.matching_status.matching), max(wait_s, 0.0))

    def _on_change(self, status: zenoh.MatchingStatus) -> None:
        with self._changed:
            self._changed.notify_all()
