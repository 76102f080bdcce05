"""A holder to be stopped or killed: `python -m tests.holding.holder_process ENDPOINT CELL SERVICE`.

Takes the arm, says "held", and asks for dwells until it is ended; says how each ended.
"""

from __future__ import annotations

import sys

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import BusError, CommandRefused
from crosspih_common.holding import hold_arm
from crosspih_common.keys import DWELL
from crosspih_common.messages import Dwell

DWELL_S = 10.0


def main(endpoint: str, cell: str, service: str) -> None:
    """Hold until ended."""
    with Bus(open_zenoh(endpoint), cell, service) as bus, hold_arm(bus, "a test") as lease:
        print("held", flush=True)
        while True:
            try:
                outcome = lease.ask(DWELL, Dwell(duration_s=DWELL_S), 60.0)
            except CommandRefused as refusal:
                print(refusal.code, flush=True)
                return
            except BusError:
                continue  # it was stopped for so long that its link was cut; the link comes back
            print(outcome.stop_reason.value, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:4])
