"""Whether a service lives: `python -m crosspih_common.bus.alive NAME [ASKER]`, the health check of a container.

Exit status 0 when the router at CROSSPIH_ENDPOINT knows the liveliness token of that service, or for `router` when it
answers; else 1, and one line on standard error that says why. In a cell with certificates, ASKER is the service whose
certificate is used; the default is NAME itself. The module imports as little as possible, because it is run often.
"""

from __future__ import annotations

import os
import sys
import threading
import time

from crosspih_common.bus.zenoh_transport import DEFAULT_ENDPOINT, open_zenoh
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import alive_key

ROUTER = "router"  # it has no token of its own: tokens need a router
CONNECT_S = 3.0
ASK_S = 3.0
AGAIN_S = 0.1
ANY_CELL = "*"


def why_not_alive(service: str, endpoint: str, asker: str) -> str:
    """Empty when the service lives; else one line that says what is wrong.

    It repeats the question until the answer is yes: at first only its own process may answer a newly opened session.
    """
    try:
        with open_zenoh(endpoint, CONNECT_S, asker) as transport:
            if service == ROUTER:
                return ""
            until, pause = time.monotonic() + ASK_S, threading.Event()
            while (left_s := until - time.monotonic()) > 0.0:
                tokens = transport.session.liveliness().get(alive_key(ANY_CELL, service), timeout=left_s)
                if any(token.ok is not None for token in tokens):
                    return ""
                pause.wait(AGAIN_S)
            return f"the router at {endpoint} knows of no {service} that lives"
    except CrosspihError as error:
        return str(error)


def main(service: str, asker: str) -> int:
    """Print what is wrong, if anything, and return the exit status."""
    why = why_not_alive(service, os.environ.get("CROSSPIH_ENDPOINT") or DEFAULT_ENDPOINT, asker)
    if why:
        print(f"{service}: {why}", file=sys.stderr)
    return 1 if why else 0


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit("python -m crosspih_common.bus.alive NAME [ASKER]: name one service, or router")
    sys.exit(main(sys.argv[1], sys.argv[-1]))
