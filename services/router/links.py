"""Whether the links to other machines' routers carry anything: Zenoh alone does not always notice that one does not.

After a cut about as long as its lease one router may have given the link up while the other still holds it for whole;
it then hears nothing, and does not connect again. So linked routers answer each other, and whoever connected asks.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import zenoh

from crosspih_common.bus.zenoh_transport import LEASE_MS
from crosspih_common.keys import router_key

ASK_S = 1.0
HANGS_S = 1e-3 * LEASE_MS + 3.0  # a link that is cut is given up within the lease, and is then no link at all


class Links:
    """Of one router's session; `clock` tells s, any origin."""

    def __init__(self, session: zenoh.Session, clock: Callable[[], float] = time.monotonic) -> None:
        self._session, self._clock = session, clock
        self._heard: dict[str, float] = {}
        own = router_key(str(session.zid()))
        self._queryable = session.declare_queryable(own, lambda query: query.reply(own, b""), complete=True)

    def hanging(self) -> str:
        """The router that is linked and has not answered for HANGS_S; empty where all do. Waits for answers ASK_S."""
        linked = [str(zid) for zid in self._session.info.routers_zid()]
        now = self._clock()
        self._heard = {zid: self._heard.get(zid, now) for zid in linked}
        for zid in linked:
            if any(reply.ok is not None for reply in self._session.get(router_key(zid), timeout=ASK_S)):
                self._heard[zid] = self._clock()
        return next((zid for zid, heard in self._heard.items() if self._clock() - heard > HANGS_S), "")
