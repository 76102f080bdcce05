"""`python -m services.router`: an embedded Zenoh router on one endpoint."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from types import FrameType

import zenoh

from crosspih_common.bus.zenoh_transport import DEFAULT_ENDPOINT, router_config
from crosspih_common.service import notify
from crosspih_common.service.urgency import be_urgent


def main() -> int:
    """Route until SIGINT or SIGTERM; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m services.router", description="The Zenoh router.")
    parser.add_argument("--endpoint", default=os.environ.get("CROSSPIH_ENDPOINT") or DEFAULT_ENDPOINT)
    parser.add_argument(
        "--peers", action="store_true", default=os.environ.get("CROSSPIH_ROUTER_PEERS") == "1",
        help="tell Zenoh peers of each other: for nodes of ROS 2 (docs/hardware/ros2.md)",
    )  # fmt: skip
    given = parser.parse_args()
    endpoint = given.endpoint
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    be_urgent()  # it does little, and everything waits for it; before Zenoh starts its threads
    try:
        session = zenoh.open(router_config(endpoint, given.peers))
    except zenoh.ZError as error:
        reason = str(error).splitlines()[0][:200]
        print(
            f"router: cannot listen on {endpoint}; is another stack up? (`crosspih ps`, or set "
            f"CROSSPIH_ENDPOINT): {reason}",
            file=sys.stderr,
            flush=True,
        )
        return 1
    try:
        print(f"router: listening on {endpoint}", flush=True)
        notify.ready()
        while not stop.wait(1.0):
            notify.watchdog()
    finally:
        session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
