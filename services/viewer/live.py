"""Binds the page to the bus: subscribes to what it shows, and sends the commands of its buttons."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, TypeVar

from crosspih_common.bus import Bus, Latest
from crosspih_common.keys import (
    ANNOTATED_LEFT,
    ANNOTATED_RIGHT,
    ASSEMBLE,
    CAMERA_CALIBRATION,
    CLOCK,
    CONTACT_STATE,
    CONTACT_WRENCH,
    ESTIMATE,
    EVENTS,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    LEASE,
    LOCATE,
    NETWORK,
    PHASE,
    SEATED,
    SEQUENCE_NETWORK,
    STATUS,
    TOUCH,
    WITHDRAW,
    Command,
)
from crosspih_common.messages import CellClock, Image, JointState, Severity
from crosspih_common.service import ServiceContext, notify
from services.viewer.asking import PageCommands
from services.viewer.browser import Browser
from services.viewer.cell_page import RIGHT_PX, CellPage, add_glass, add_view_buttons, look_from
from services.viewer.charts import chart_of
from services.viewer.config import ViewerConfig
from services.viewer.controls import Controls
from services.viewer.timeline import StampedPicture, Timeline
from services.viewer.words import STYLE, themes

POLITE = 10  # nice: the processes that move the arm come first
MOST_WAITING = 200_000
IDLE_S = 30.0  # length of the force chart while there was no assembly yet
HeardT = TypeVar("HeardT")


class ViewerShell:
    """The page of a running cell."""

    def __init__(self, context: ServiceContext, config: ViewerConfig, browser: Browser) -> None:
        self._context, self._config, self._browser = context, config, browser
        workcell, bus, server = context.cell.workcell, context.bus, browser.server
        self._timeline = Timeline(workcell.arm().joints)
        self._waiting: deque[Callable[[], None]] = deque(maxlen=MOST_WAITING)
        self._alive: set[str] = set()
        self._clock: CellClock | None = None
        self._lease = bus.latest(LEASE)
        self._chart_key: tuple[int, int, int] = (-1, -1, -1)
        server.gui.add_html(STYLE)
        self._page = CellPage(server, workcell)
        self._controls: Controls | None = None
        if config.commands:
            asking = PageCommands(bus, self._lease.value, lambda: self._clock is not None and self._clock.simulated)
            self._controls = Controls(server, asking, workcell.peg.shape().outline.name, context.cell.path.name)
        add_view_buttons(server, self._page.views)
        add_glass(server, [self._page])
        server.gui.add_html(themes())
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(RIGHT_PX)
        look_from(server, self._page.views["cell"])
        self._listen(bus)
        self._closing = threading.Event()
        if hasattr(os, "nice"):
            os.nice(POLITE)
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._thread.start()
        context.works.watch("the page", self._thread.is_alive)
        self._tell_where()

    def _tell_where(self) -> None:
        browser = self._browser
        notify.status(browser.address)
        moved = f" ({browser.moved})" if browser.moved else ""
        self._context.event(Severity.INFO, "page", f"{browser.without_token}{moved}")
        if browser.address != browser.without_token:
            print(f"viewer: {browser.address}", flush=True)  # the token goes to the log alone, and never over the bus

    def _listen(self, bus: Bus) -> None:
        timeline, later = self._timeline, self._later
        bus.subscribe_inline(CLOCK, self._on_clock)
        bus.subscribe_inline(CONTACT_WRENCH, later(timeline.contact_wrench))
        bus.subscribe_inline(CONTACT_STATE, later(timeline.contact_state))
        bus.subscribe_inline(PHASE, later(timeline.phase))
        bus.subscribe_inline(TOUCH, later(timeline.touch))
        bus.subscribe_inline(CAMERA_CALIBRATION, later(timeline.calibration))
        bus.subscribe_inline(LEASE, later(timeline.lease))
        bus.subscribe_inline(STATUS, later(timeline.status))
        bus.subscribe_inline(EVENTS, later(timeline.event))
        bus.subscribe_inline(IMAGE_LEFT, later(self._picture("left")))
        bus.subscribe_inline(IMAGE_RIGHT, later(self._picture("right")))
        bus.subscribe_inline(ANNOTATED_LEFT, later(self._picture("annotated left")))
        bus.subscribe_inline(ANNOTATED_RIGHT, later(self._picture("annotated right")))
        answers: tuple[tuple[Command[Any, Any], Callable[[Any], None]], ...] = (
            (LOCATE, timeline.hole),
            (ESTIMATE, lambda heard: timeline.estimate(heard, "touches")),
            (NETWORK, lambda heard: timeline.estimate(heard, "the network")),
            (SEQUENCE_NETWORK, lambda heard: timeline.estimate(heard, "the sequence network")),
            (SEATED, lambda heard: timeline.estimate(heard, "the bore's walls")),
            (ASSEMBLE, timeline.result),
            (WITHDRAW, timeline.withdraw),
        )
        for command, take in answers:
            bus.subscribe_inline(command.reply_echo, later(take))
        bus.watch_alive(self._on_alive)

    def _later(self, take: Callable[[HeardT], None]) -> Callable[[HeardT], None]:
        """A callback that queues what arrives; the page's own thread takes it when it draws next."""
        return lambda heard: self._waiting.append(lambda: take(heard))

    def _on_clock(self, tick: CellClock) -> None:
        again = self._clock is not None and self._clock.boot_id != tick.boot_id
        self._clock = tick
        self._waiting.append(self._timeline.clear if again else lambda: self._timeline.tick(tick.stamp_ns))

    def _on_alive(self, service: str, alive: bool) -> None:
        (self._alive.add if alive else self._alive.discard)(service)

    def _picture(self, name: str) -> Callable[[Image], None]:
        return lambda heard: self._timeline.picture(name, StampedPicture(heard.stamp_ns, lambda: heard))

    # ------------------------------------------------------------------------------------------------------- drawing

    def _run(self) -> None:
        told_at = 0.0
        joints: Latest[JointState] | None = None
        with ExitStack() as looking:
            while not self._closing.wait(1.0 / self._config.scene_hz):
                while self._waiting:
                    self._waiting.popleft()()
                self._timeline.forget()
                if not self._browser.server.get_clients():
                    looking.close()  # no client: draw nothing, and do not subscribe to the fastest stream
                    joints = None
                    continue
                if joints is None:
                    joints = looking.enter_context(self._context.bus.reading(JOINT_STATE))
                told_at = self._draw(joints.value(), told_at)

    def _draw(self, joints: JointState | None, told_at: float) -> float:
        """Draw the scene, and the panels if their last update is long enough ago. Returns the time of the panels' last
        update.
        """
        if joints is not None:
            self._timeline.joint_state(joints)
        with self._browser.server.atomic():
            self._page.move(self._timeline.at(self._timeline.last_ns))
        now = time.monotonic()
        if now - told_at < 1.0 / self._config.chart_hz:
            return told_at
        self._tell()
        return now

    def _tell(self) -> None:
        timeline, clock = self._timeline, self._clock
        moment = timeline.at(timeline.last_ns)
        key = (moment.trial_ns, len(timeline.wrench), len(moment.spans))
        chart = None
        if key != self._chart_key:
            self._chart_key = key
            end_ns = moment.stamp_ns if moment.result is None else min(moment.result.stamp_ns, moment.stamp_ns)
            since = moment.trial_ns
            if moment.phase is None:
                since = max(since, round(end_ns - IDLE_S * 1e9))
            chart = chart_of(moment, *timeline.wrenches(since, end_ns))
        self._page.tell(moment, chart, alive=frozenset(self._alive))
        if self._controls is not None:
            realtime, simulated = (None, None) if clock is None else (clock.realtime, clock.simulated)
            self._controls.show(moment, realtime, simulated)

    def close(self) -> None:
        """Close the page."""
        self._closing.set()
        self._thread.join()
        self._browser.close()
