"""What a query leaves behind in the process that asked: `python -m tests.bus.measure_query_memory`. Linux with glibc.

By zenoh-python alone, and by `Bus.call` on top of it, asker and server in one process and one session, without a
router. Zenoh has a task for each query that sleeps until its timeout, answered or not (`SessionInner::query` in
zenoh/src/api/session.rs): so memory is given back when that has passed, and not before.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import threading
import time
from collections.abc import Callable

import zenoh

from crosspih_common.bus import Bus
from crosspih_common.bus.zenoh_transport import PAST_DEADLINE_S, ZenohTransport
from crosspih_common.keys import STOP
from crosspih_common.messages import StopAccepted, StopMotion

FIRST = 300  # queries before anything is counted: what is made once
ALONE = {
    "mode": "peer", "listen/endpoints": [], "connect/endpoints": [], "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False, "timestamping/enabled": True,
}  # fmt: skip


class _Mallinfo2(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            "arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost",
        )
    ]  # fmt: skip


def in_use_kb() -> float:
    """What malloc has given out and not got back, of its main arena."""
    libc = ctypes.CDLL("libc.so.6")
    libc.mallinfo2.restype = _Mallinfo2
    gc.collect()
    return float(libc.mallinfo2().uordblks) / 1024.0


def session() -> zenoh.Session:
    """One that speaks with nobody."""
    config = zenoh.Config()
    for name, value in ALONE.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


def measure(what: str, ask: Callable[[], object], timeout_s: float, queries: int, rounds: int) -> None:
    """Print what each round of queries left at once, and once their timeouts have passed, all rounds together."""
    for _ in range(FIRST):
        ask()
    time.sleep(timeout_s + 1.0)
    before_kb, objects = in_use_kb(), len(gc.get_objects())
    for number in range(1, rounds + 1):
        began_kb = in_use_kb()
        for _ in range(queries):
            ask()
        at_once_kb = in_use_kb() - began_kb
        time.sleep(timeout_s + 1.0)
        print(
            f"{what}, {number * queries} queries, timeout {timeout_s:g} s: the last {queries} took "
            f"{at_once_kb:.0f} kB, after their timeout all of them together hold {in_use_kb() - before_kb:.0f} kB, "
            f"{len(gc.get_objects()) - objects:+} Python objects",
            flush=True,
        )


def main() -> None:
    """Both, one after the other."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--queries", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--deadline-s", type=float, default=5.0)
    given = parser.parse_args()
    timeout_s = given.deadline_s + PAST_DEADLINE_S

    with session() as alone:

        def answer(query: zenoh.Query) -> None:
            query.reply("a", b"x" * 100)
            query.drop()

        alone.declare_queryable("a", answer, complete=True)

        def ask() -> None:
            done = threading.Event()
            replies: list[zenoh.Reply] = []
            alone.get("a", zenoh.handlers.Callback(replies.append, done.set), payload=b"y" * 100, timeout=timeout_s)
            assert done.wait(given.deadline_s) and replies[0].ok is not None

        measure("zenoh alone", ask, timeout_s, given.queries, given.rounds)

    with Bus(ZenohTransport(session(), "nowhere"), "c", "hardware") as bus:
        bus.serve(STOP, lambda request: StopAccepted(was_moving=False))
        measure(
            "Bus.call", lambda: bus.call(STOP, StopMotion(), given.deadline_s), timeout_s, given.queries, given.rounds
        )


if __name__ == "__main__":
    main()
