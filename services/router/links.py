"""Whether the links to other machines' routers still work: Zenoh does not always restore them by itself.

After a cut about as long as its lease, one router may have given the link up while the other still holds it for whole.
The other router then discards what it is sent, and does not connect again. So linked routers answer each other,
whichever of them connected, and a router reports when too few answer though they can be reached.
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
LACKS_S = 1e-3 * RETRY_MS + 5.0  # by then Zenoh itself has tried again, and the link is restored a moment later
ADDRESS = re.compile(r"\w+/\[?(?P<host>[^\]]+?)\]?:(?P<port>\d+)")


def reachable(endpoints: Sequence[str]) -> bool:
    """Whether every endpoint accepts a TCP connection."""
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
    """The links of one router's session, which connects to the routers at `endpoints`; `clock` gives seconds from any
    origin.
    """

    def __init__(
        self,
        session: zenoh.Session,
        endpoints: Sequence[str],
        reach: Callable[[Sequence[str]], bool] = reachable,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._endpoints, self._reach, self._clock = session, endpoints, reach, clock
        self._whole_at: float | None = None  # None until all links have worked once
        own = router_key(str(session.zid()))
        self._queryable = session.declare_queryable(own, lambda query: query.reply(own, b""), complete=True)

    def hang(self) -> bool:
        """Whether, for longer than LACKS_S, fewer routers have answered than this one connects to, although all can be
        reached and all have answered before. Waits ASK_S for each answer.
        """
        answering = sum(self._answers(str(zid)) for zid in self._session.info.routers_zid())
        if answering >= len(self._endpoints):
            self._whole_at = self._clock()
            return False
        overdue = self._whole_at is not None and self._clock() - self._whole_at > LACKS_S
        return overdue and self._reach(self._endpoints)

    def _answers(self, zid: str) -> bool:
        return any(reply.ok is not None for reply in self._session.get(router_key(zid), timeout=ASK_S))
