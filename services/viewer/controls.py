"""The page's buttons."""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

from crosspih_common.messages import Phase, Strategy
from services.viewer.asking import PageAnswer, PageCommands
from services.viewer.timeline import SceneMoment
from services.viewer.words import holder

if TYPE_CHECKING:
    import viser

STRATEGIES = tuple(one.value for one in Strategy if one is not Strategy.KNOWN_POSE)  # which needs a pose as well
MOST_SEED = 2**31 - 1
FIXED = "peg, cell and speed are fixed when a stack starts: <code>crosspih down</code>, then for example "
HOW = "<code>CROSSPIH_SPEED=max crosspih up</code> or <code>CROSSPIH_CELL=FILE crosspih up</code>"


class Controls:
    """Buttons in the main panel; the answer to a command is shown below them, in words."""

    def __init__(self, server: viser.ViserServer, asking: PageCommands, peg: str, cell: str) -> None:
        gui, self._asking = server.gui, asking
        self._fixed = f"peg <b>{escape(peg)}</b>, cell <b>{escape(cell)}</b>"
        self._paused = False
        self._strategy = gui.add_dropdown("Strategy", STRATEGIES, initial_value=Strategy.FUSED.value)
        self._seed = gui.add_number("Seed", 1, min=0, max=MOST_SEED, step=1)
        self._fresh = gui.add_checkbox(
            "New trial first", initial_value=True, hint="simulated cells: reset with the seed"
        )
        self._assemble = gui.add_button("Assemble", color="green")
        self._pause = gui.add_button("Pause", color="yellow", disabled=True)
        self._stop = gui.add_button("Stop", color="red", hint="the assembly ends, and the peg is backed off")
        self._withdraw = gui.add_button("Withdraw the peg", color="gray")
        self._reset = gui.add_button("New trial", color="gray", hint="reset the simulated cell with the seed")
        self._answer = gui.add_html("")
        self._about = gui.add_html("")
        self._said: dict[int, str] = {}
        self._real = gui.add_checkbox(
            "The cell was checked", initial_value=False, visible=False,
            hint="this arm is real: `crosspih cell check` has passed since the cell was started",
        )  # fmt: skip
        pressed: tuple[tuple[Any, str, Callable[[], PageAnswer]], ...] = (
            (self._assemble, "asked for an assembly", self._ask_assembly),
            (self._stop, "asked to stop", asking.stop),
            (self._pause, "asked", self._ask_pause),
            (self._withdraw, "asked to withdraw the peg", asking.withdraw),
            (self._reset, "asked for a new trial", lambda: asking.reset(int(self._seed.value))),
        )
        for button, doing, ask in pressed:
            button.on_click(self._on_click(doing, ask))

    def _on_click(self, doing: str, ask: Callable[[], PageAnswer]) -> Callable[[Any], None]:
        def clicked(event: Any) -> None:
            # an assembly takes minutes: a thread of its own keeps the page's threads free
            threading.Thread(target=self._carry_out, args=(doing, ask), name="asking", daemon=True).start()

        return clicked

    def _carry_out(self, doing: str, ask: Callable[[], PageAnswer]) -> None:
        self._say(self._answer, f'<div class="cp dim">{doing} ...</div>')
        answer = ask()
        style = "note" if answer.good else "note bad"
        colour = ";border-left-color:#40c057" if answer.good else ""
        self._say(
            self._answer, f'<div class="cp"><div class="{style}" style="{colour}">{escape(answer.text)}</div></div>'
        )

    def _ask_assembly(self) -> PageAnswer:
        if self._real.visible and not self._real.value:
            return PageAnswer(False, "this arm is real: run `crosspih cell check` first, and then tick the box")
        seed = int(self._seed.value) if self._fresh.value else None
        return self._asking.assemble(Strategy(self._strategy.value), seed)

    def _ask_pause(self) -> PageAnswer:
        answer = self._asking.pause(not self._paused)
        if answer.good:
            self._paused = not self._paused
        return answer

    def show(self, moment: SceneMoment, realtime: bool | None, simulated: bool | None) -> None:
        """Enable the buttons that can be pressed now; `realtime` and `simulated` are None before the first tick of the
        clock.
        """
        busy = self._asking.busy
        running = moment.phase is not None and moment.phase.phase not in (Phase.DONE, Phase.IDLE)
        if not running:
            self._paused = False
        for button in (self._assemble, self._withdraw, self._reset):
            self._set(button, "disabled", bool(busy))
        self._set(self._pause, "disabled", not running)
        self._set(self._pause, "label", "Go on" if self._paused else "Pause")
        self._set(self._reset, "visible", simulated is not False)
        self._set(self._fresh, "visible", simulated is not False)
        self._set(self._seed, "visible", simulated is not False)
        self._set(self._real, "visible", simulated is False)
        speed = "not known yet" if realtime is None else "real time" if realtime else "as fast as it goes"
        why = f'<div class="dim">{escape(busy)}</div>' if busy and moment.lease is not None else ""
        about = f'{holder(moment)}{why}<div class="dim">{self._fixed}, speed <b>{speed}</b>; {FIXED}{HOW}</div>'
        self._say(self._about, f'<div class="cp">{about}</div>')

    def _say(self, html: Any, text: str) -> None:
        if self._said.get(id(html)) != text:
            self._said[id(html)] = html.content = text

    @staticmethod
    def _set(handle: Any, name: str, value: object) -> None:
        if getattr(handle, name) != value:
            setattr(handle, name, value)
