"""`python -m services.router`: an embedded Zenoh router, and its links to those of other machines.

With CROSSPIH_CERTIFICATES it lets in only certificates of that folder's authority, and allows each service what the key
table says (crosspih_common/security/access.py).
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from types import FrameType
from typing import TYPE_CHECKING

import zenoh

from crosspih_common.bus.zenoh_transport import DEFAULT_ENDPOINT, router_config
from crosspih_common.endpoints import checked
from crosspih_common.errors import CONFIG_STATUS, ConfigError, CrosspihError
from crosspih_common.security import credentials_from_environment, open_to_whom, secure_endpoint
from crosspih_common.service import notify
from crosspih_common.service.ending import end_process
from crosspih_common.service.urgency import be_urgent

if TYPE_CHECKING:
    from services.router.telling import Telling


def _telling(cell: str | None) -> tuple[type[Telling], str]:
    """The object that reports refusals, and the cell on whose bus. Imported only here: a plain router needs none of it.

    Raises ConfigError for a cell's file that cannot be read.
    """
    from crosspih_common.config import load_cell
    from crosspih_common.modules import DEFAULT_CELL
    from services.router.telling import Telling

    return Telling, load_cell(cell or DEFAULT_CELL).workcell.name


def _endpoints(text: str) -> list[str]:
    return [one.strip() for one in text.split(",") if one.strip()]


def main() -> int:
    """Route until SIGINT or SIGTERM; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m services.router", description="The Zenoh router.")
    parser.add_argument("--endpoint", default=os.environ.get("CROSSPIH_ENDPOINT") or DEFAULT_ENDPOINT)
    parser.add_argument(
        "--peers", action="store_true", default=os.environ.get("CROSSPIH_ROUTER_PEERS") == "1",
        help="tell Zenoh peers of each other: for nodes of ROS 2 (docs/hardware/ros2.md)",
    )  # fmt: skip
    parser.add_argument(
        "--listen", default=os.environ.get("CROSSPIH_ROUTER_LISTEN", ""), metavar="ENDPOINTS",
        help="where other machines' routers may connect to, separated by commas; nowhere without it",
    )  # fmt: skip
    parser.add_argument(
        "--routers", default=os.environ.get("CROSSPIH_ROUTERS", ""), metavar="ENDPOINTS",
        help="other machines' routers to connect to, separated by commas (docs/several-machines.md)",
    )  # fmt: skip
    parser.add_argument(
        "--cell", default=os.environ.get("CROSSPIH_CELL"),
        help="the cell's YAML file: refusals are reported on its bus, where there are certificates",
    )  # fmt: skip
    given = parser.parse_args()
    endpoint, listen, routers = given.endpoint, _endpoints(given.listen), _endpoints(given.routers)
    try:
        checked(endpoint)
        for field, several in (("CROSSPIH_ROUTER_LISTEN", listen), ("CROSSPIH_ROUTERS", routers)):
            for one in several:
                checked(one, field)
        credentials = credentials_from_environment("router", endpoint)
        kind, cell = _telling(given.cell) if credentials else (None, "")
    except CrosspihError as error:
        print(f"router: {error}", file=sys.stderr, flush=True)
        return CONFIG_STATUS if isinstance(error, ConfigError) else 1
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    be_urgent()  # it does little, but everything waits for it; before Zenoh starts its threads
    telling = kind() if kind is not None else None  # urgent too: Zenoh waits for the reader of its log
    try:
        session = zenoh.open(router_config(endpoint, given.peers, credentials, listen, routers))
    except zenoh.ZError as error:
        reason = str(error).splitlines()[0][:200]
        print(
            f"router: cannot listen on {', '.join((endpoint, *listen))}; is another stack up? (`crosspih ps`, or set "
            f"CROSSPIH_ENDPOINT): {reason}",
            file=sys.stderr,
            flush=True,
        )
        return 1  # and is started again: a predecessor may still be releasing the port
    bus = None
    try:
        if telling is not None:
            bus = telling.to(session, endpoint, cell)
        listening = [secure_endpoint(one) if credentials else one for one in (endpoint, *listen)]
        print(f"router: listening on {', '.join(listening)}", flush=True)
        if routers:
            print(f"router: connects to {', '.join(routers)}", flush=True)
        for one in (endpoint, *listen):
            if said := open_to_whom(one):
                print(f"router: {said}", flush=True)
                notify.status(said)
        links = None
        if listen or routers:
            from services.router.links import Links  # it loads the key table, which a plain router does not need

            links = Links(session, routers)
        notify.ready()
        while not stop.wait(1.0):
            notify.watchdog()
            if links is not None and routers and links.hang():
                print(
                    "router: a link to another one hangs: ended, so that it is made anew", file=sys.stderr, flush=True
                )
                return 1
    finally:
        if bus is not None:
            bus.close()
        session.close()
    return 0


if __name__ == "__main__":
    end_process(main())
