"""The messages of an assembly in a terminal, one line each, and its current state in a panel below them."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console, ConsoleOptions, RenderResult
from rich.live import Live

from crosspih_common.keys import CONTACT_WRENCH, ESTIMATE
from crosspih_common.messages import AssemblyPhase, ContactWrench, Event, PoseErrorEstimate, Touch
from services.operator.assembly.display.drawing import drawn
from services.operator.assembly.display.standing import AssemblyStanding, Caps
from services.operator.assembly.session import Session
from services.operator.assembly.show import Story

FRAMES_A_SECOND = 8
# the arm's default caps where the cell's file sets none (docs/wire.md)
FORCE_CAP_N, MOMENT_CAP_NM = 60.0, 6.0


def caps_of(sections: Mapping[str, Mapping[str, Any]]) -> Caps:
    """The caps of a cell's file."""
    limits = sections.get("hardware", {}).get("limits") or {}
    return Caps(float(limits.get("force_cap_n", FORCE_CAP_N)), float(limits.get("moment_cap_nm", MOMENT_CAP_NM)))


class LiveStory(Story):
    """Prints as Story does, above a panel; fed on the bus's threads, drawn on the display's."""

    def __init__(self, console: Console, standing: AssemblyStanding) -> None:
        super().__init__(console)
        self._standing, self._lock = standing, threading.Lock()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        with self._lock:
            yield drawn(self._standing, options.max_width)

    def begin(self, now_ns: int) -> None:
        """See Story."""
        super().begin(now_ns)
        with self._lock:
            self._standing.begin(now_ns)

    def phase(self, phase: AssemblyPhase) -> None:
        """See Story."""
        super().phase(phase)
        with self._lock:
            self._standing.add_phase(phase)

    def touch(self, touch: Touch) -> None:
        """See Story."""
        super().touch(touch)
        with self._lock:
            self._standing.add_touch(touch)

    def event(self, event: Event) -> None:
        """See Story."""
        super().event(event)
        with self._lock:
            self._standing.add_event(event)

    def wrench(self, felt: ContactWrench) -> None:
        """The wrench of the sensor."""
        with self._lock:
            self._standing.add_wrench(felt)

    def estimate(self, estimate: PoseErrorEstimate) -> None:
        """The estimate from the touches."""
        with self._lock:
            self._standing.add_estimate(estimate)


@contextmanager
def live_story(console: Console, session: Session, title: str, plain: bool) -> Iterator[Story]:
    """A Story fed from a session: with a panel in a terminal; elsewhere, or with `plain`, only its lines."""
    if plain or not console.is_terminal:
        story = Story(console)
        session.follow_events(story.phase, story.touch, story.event)
        yield story
        return
    live = LiveStory(console, AssemblyStanding(title, caps_of(session.cell.sections)))
    session.follow_events(live.phase, live.touch, live.event)
    session.bus.subscribe(CONTACT_WRENCH, live.wrench)
    session.bus.subscribe(ESTIMATE.reply_echo, live.estimate)
    with Live(live, console=console, refresh_per_second=FRAMES_A_SECOND, transient=True):
        yield live
