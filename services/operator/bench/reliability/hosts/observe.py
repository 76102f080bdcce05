"""One assembly requested on a host, and what that host observed: `python -m ...bench.reliability.hosts.observe SEED`.

Prints a JSON object a line: {"step": phase} for each phase of the planner, and at the end {"seen": Seen}. Meanwhile it
calls a light command again and again, so that the latency is measured during an assembly.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections import Counter

from pydantic import BaseModel

from crosspih_common.bus import Bus
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import FT_CALIBRATION, WALL_CLOCK
from crosspih_common.messages import AskWallClock, AssemblyPhase, Event, ResetCell, Strategy
from crosspih_common.service.wall_clock import measured
from services.operator.assembly.session import NEEDED, Session
from services.operator.scoring.score import seen_in_words

CONNECT_S = 20.0
SERVICES_S = 120.0
ASK_EVERY_S = 0.1
ASK_DEADLINE_S = 10.0
CALIBRATION_SEED, CALIBRATION_DWELL_S = 0, 0.25
CALIBRATED_S = 1.0  # a late subscriber gets the state of an earlier calibration within this time


class HostObservation(BaseModel):
    """The result of an assembly, as seen from the host that requested it. Latencies in s."""

    inserted: bool = False
    failure: str = ""
    vision: str = ""  # what it had to do with it
    detail: str = ""
    duration_s: float | None = None
    wall_s: float = 0.0
    latencies_s: list[float] = []
    unanswered: int = 0
    events: dict[str, int] = {}  # code: how often
    texts: dict[str, str] = {}  # code: the first text
    recording: str | None = None
    warnings: list[str] = []  # of the recording
    wall_ahead_s: float | None = None  # this host's wall clock relative to the cell's
    wall_bound_s: float | None = None


class Asking:
    """Calls the lightest command, the cell's wall clock, again and again; counts the calls without an answer."""

    def __init__(self, bus: Bus) -> None:
        self._bus, self._stop = bus, threading.Event()
        self.latencies_s: list[float] = []
        self.unanswered = 0
        self._thread = threading.Thread(target=self._run, name="asking", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(ASK_EVERY_S):
            began_s = time.monotonic()
            try:
                self._bus.call(WALL_CLOCK, AskWallClock(), ASK_DEADLINE_S)
                self.latencies_s.append(time.monotonic() - began_s)
            except CrosspihError:
                self.unanswered += 1

    def close(self) -> None:
        """Stop calling, and wait for the call under way."""
        self._stop.set()
        self._thread.join()


def observe(seed: int) -> HostObservation:
    """Reset, assemble, record, call. Failures are part of the observation."""
    events: Counter[str] = Counter()
    texts: dict[str, str] = {}

    def on_event(event: Event) -> None:
        events[event.code] += 1
        texts.setdefault(event.code, f"{event.service}: {event.text}")

    def on_phase(phase: AssemblyPhase) -> None:
        print(json.dumps({"step": phase.phase.value}), flush=True)

    began_s = time.monotonic()
    with Session(CONNECT_S) as session:
        session.wait_for_services(SERVICES_S, (*NEEDED, "recorder"))
        with session.bus.reading(FT_CALIBRATION) as calibrated:
            if calibrated.wait_for(lambda told: told.calibrated, CALIBRATED_S) is None:
                session.new_trial(ResetCell(seed=CALIBRATION_SEED))
                session.calibrate_ft(CALIBRATION_DWELL_S)
        session.follow_events(on_phase, lambda touch: None, on_event)
        wall = measured(session.bus)
        asking = Asking(session.bus)
        seen = HostObservation()
        began_s = time.monotonic()
        try:
            figures, _ = session.trial(seed, Strategy.FUSED, True)
            seen = HostObservation(
                inserted=figures.inserted, failure=figures.failure or "", detail=figures.failure_detail,
                vision=seen_in_words(figures),
                duration_s=figures.duration_s, recording=figures.recording, warnings=list(figures.recording_warnings),
            )  # fmt: skip
        except CrosspihError as error:
            seen = HostObservation(failure=type(error).__name__, detail=str(error))
        finally:
            asking.close()
    return seen.model_copy(
        update={
            "wall_s": time.monotonic() - began_s,
            "latencies_s": asking.latencies_s,
            "unanswered": asking.unanswered,
            "events": dict(events),
            "texts": texts,
            "wall_ahead_s": None if wall is None else wall.offset_s,
            "wall_bound_s": None if wall is None else wall.bound_s,
        }
    )


def main(seed: int) -> int:
    """Print the observation; the exit status is that of an assembly."""
    try:
        seen = observe(seed)
    except CrosspihError as error:  # it did not even begin
        seen = HostObservation(failure=type(error).__name__, detail=str(error))
    print(json.dumps({"seen": seen.model_dump(mode="json")}), flush=True)
    return 0 if seen.inserted else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
