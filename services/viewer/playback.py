"""The page of a recording, or of two side by side, with a time slider; no stack is needed."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crosspih_common.errors import ConfigError
from services.viewer.browser import Browser, open_browser
from services.viewer.cell_page import RIGHT_PX, CellPage, add_glass, add_view_buttons, look_from
from services.viewer.charts import chart_of
from services.viewer.playhead import SPEEDS, Playhead
from services.viewer.tape import ShownRecording, read_tape
from services.viewer.view_points import view_points
from services.viewer.words import STYLE, themes

if TYPE_CHECKING:
    import viser

FRAME_S = 1 / 25
TELL_S = 0.2
MOST = 2
APART_M = 0.95
BEFORE_S = 0.5  # an assembly that begins less than this after the start of the recording is not preceded by extra time


class Shown:
    """A recording on the page; its times count from the beginning of its first assembly."""

    def __init__(self, server: viser.ViserServer, tape: ShownRecording, name: str, offset_m: np.ndarray) -> None:
        self._tape, self._timeline = tape, tape.timeline
        trials = self._timeline.trials_ns()
        self.zero_ns = trials[0] if trials else self._timeline.first_ns
        self.first_s = (self._timeline.first_ns - self.zero_ns) * 1e-9
        self.last_s = (self._timeline.last_ns - self.zero_ns) * 1e-9
        end = self._timeline.at(self._timeline.last_ns)
        told = [span.from_ns for span in end.spans] + [touch.stamp_ns for touch in end.touches]
        self.marks_s = [(stamp - self.zero_ns) * 1e-9 for stamp in told]
        self._name = name
        self.page = CellPage(server, tape.cell.workcell, name, offset_m)
        self._trial_end = end

    def _stamp(self, at_s: float) -> int:
        return min(max(self.zero_ns + round(at_s * 1e9), self._timeline.first_ns), self._timeline.last_ns)

    def move(self, at_s: float) -> None:
        """Update the scene to a time."""
        self.page.move(self._timeline.at(self._stamp(at_s)))

    def tell(self, at_s: float) -> None:
        """Update the panels to a time; the chart is of the whole assembly, with the time marked in it."""
        stamp = self._stamp(at_s)
        moment, end = self._timeline.at(stamp), self._trial_end
        if moment.trial_ns != end.trial_ns and moment.trial_ns > end.trial_ns:
            end = moment
        times_s, wrenches = self._timeline.wrenches(end.trial_ns, end.stamp_ns)
        chart = chart_of(end, times_s, wrenches, max((stamp - end.trial_ns) * 1e-9, 0.0))
        named = f'<div class="cp"><b>{self._name}</b></div>' if self._name else ""
        self.page.tell(moment, chart, named)


class PlaybackPage:
    """The page; `run` shows it until `stop` is set."""

    def __init__(self, browser: Browser, tapes: Sequence[ShownRecording]) -> None:
        self.browser = browser
        server = browser.server
        server.gui.add_html(STYLE)
        names = [""] if len(tapes) == 1 else names_of([tape.path for tape in tapes])
        first = tapes[0].cell.workcell
        views = view_points(first)
        aside = np.cross(views["cell"].up, views["cell"].eye_m - views["cell"].target_m)
        aside *= APART_M / np.linalg.norm(aside)
        self._shown = [
            Shown(server, tape, name, aside * (index - (len(tapes) - 1) / 2))
            for index, (tape, name) in enumerate(zip(tapes, names, strict=True))
        ]
        for above, below in pairwise(self._shown):
            below.page.panel.dock_below(above.page.panel)
        marks = [mark for shown in self._shown for mark in shown.marks_s]
        first_s, last_s = min(one.first_s for one in self._shown), max(one.last_s for one in self._shown)
        self.head = Playhead(first_s if first_s < -BEFORE_S else 0.0, last_s, marks)
        self._controls(server)
        if len(tapes) == 1:
            add_view_buttons(server, self._shown[0].page.views)
        add_glass(server, [shown.page for shown in self._shown])
        for tape in tapes:
            said = [f"<b>{tape.path.name}</b>", f"cell {tape.cell.workcell.name}", *tape.notes]
            server.gui.add_html('<div class="cp dim">' + "<br>".join(said) + "</div>")
        server.gui.add_html(themes())
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(RIGHT_PX)
        point = views["cell"]
        if len(tapes) > 1:
            point = type(point)(point.target_m + (point.eye_m - point.target_m) * 2.1, point.target_m, point.up)
        look_from(server, point)

    _slider: viser.GuiSliderHandle[float]
    _play: viser.GuiButtonHandle

    def _controls(self, server: viser.ViserServer) -> None:
        head = self.head
        self._slider = server.gui.add_slider("Time, s", round(head.first_s, 2), round(head.last_s, 2), 0.01, 0.0)
        self._play = server.gui.add_button("Play", color="green")
        steps = server.gui.add_button_group("Step", ("◀ previous", "next ▶"))
        speeds = server.gui.add_button_group("Speed", SPEEDS)
        head.seek(0.0)

        @self._slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:
                head.seek(self._slider.value)

        @self._play.on_click
        def _(event: object) -> None:
            (head.pause if head.playing else head.play)()

        @steps.on_click
        def _(event: object) -> None:
            head.step(steps.value.startswith("next"))

        @speeds.on_click
        def _(event: object) -> None:
            head.speed(float(speeds.value))

    def run(self, stop: threading.Event) -> None:
        """Until `stop` is set."""
        before, told_at, told_s = time.monotonic(), 0.0, None
        while not stop.wait(FRAME_S):
            now = time.monotonic()
            at_s = self.head.advance(now - before)
            before = now
            with self.browser.server.atomic():
                for shown in self._shown:
                    shown.move(at_s)
            if now - told_at < TELL_S:
                continue
            told_at = now
            label = "Pause" if self.head.playing else "Play"
            if self._play.label != label:
                self._play.label = label
            if at_s != told_s:
                told_s = at_s
                self._slider.value = round(at_s, 2)  # type: ignore[misc]  # viser's property has a setter
                for shown in self._shown:
                    shown.tell(at_s)


def names_of(paths: Sequence[Path]) -> list[str]:
    """Names for recordings on a page: those of their files, or A and B where those are equal."""
    stems = [path.stem for path in paths]
    return stems if len(set(stems)) == len(stems) else [f"{chr(65 + index)} {stem}" for index, stem in enumerate(stems)]


def play(files: Sequence[Path], cell_file: Path | None, host: str, port: int | None, token: str) -> PlaybackPage:
    """The page of one or two recordings.

    Raises RecordingError and ConfigError in one line.
    """
    if not 1 <= len(files) <= MOST:
        raise ConfigError(f"{len(files)} recordings: the page shows one, or two side by side")
    tapes = [read_tape(file, cell_file) for file in files]
    title = "crosspih: " + ("recording" if len(files) == 1 else "two recordings")
    browser = open_browser(host, port, title, token)
    return PlaybackPage(browser, tapes)
