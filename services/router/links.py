"""Whether the links to other machines' routers still work: Zenoh does not always restore them by itself.

After a cut about as long as its lease one router may have given the link up while the other still holds it for whole;
the one is then sent what it throws away, and does not connect again. So linked routers answer each other, whoever
connected asks, and says when too few answer though they can be reached.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable, Sequence

import zenoh

from crosspih_common.bus.zenoh_transport import RETRY_MS
from crosspih_common.keys import router_key

ASK_S = 1.0
LACKS_S = 1e-3 * RETRY_MS + 5.0  # Zenoh itself has tried again by then, and the link is whole a moment later
ADDRESS = re.compile(r"\w+/\[?(?P<host>[^\]]+?)\]?:(?P<port>\d+)")


def reachable(endpoints: Sequence[str]) -> bool:
    """Whether something accepts a TCP connection at every one."""
    for endpoint in endpoints:
        address = ADDRESS.match(endpoint)
        if address is None:
            return False
        try:
            socket.create_connection((address["host"], int(address["port"])), ASK_S).close()
        except OSError:
            return False
    return True


class Links:
    """Of one router's session, which connects to the routers at `endpoints`; `clock` tells s, any origin."""

    def __init__(
        self,
        session: zenoh.Session,
        endpoints: Sequence[str],
        reach: Callable[[Sequence[str]], bool] = reachable,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._endpoints, self._reach, self._clock = session, endpoints, reach, clock
        self._whole_at: float | None = None  # None before they were once
        own = router_key(str(session.zid()))
        self._queryable = session.declare_queryable(own, lambda query: query.reply(own, b""), complete=True)

    def hang(self) -> bool:
        """Whether fewer routers have answered for LACKS_S than this one connects to, though all can be reached, and
        once all did. Waits for answers ASK_S each."""
        answering = sum(self._answers(str(zid)) for zid in self._session.info.routers_zid())
        if answering >= len(self._endpoints):
            self._whole_at = self._clock()
            return False
        overdue = self._whole_at is not None and self._clock() - self._whole_at > LACKS_S
        return overdue and self._reach(self._endpoints)

    def _answers(self, zid: str) -> bool:
        return any(reply.ok is not None for reply in self._session.get(router_key(zid), timeout=ASK_S))
