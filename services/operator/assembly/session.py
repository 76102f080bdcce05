"""A connection to a running cell: wait for its services, run a trial on it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.bus.workers import Pump
from crosspih_common.config import CellFile, load_cell
from crosspih_common.errors import NoService
from crosspih_common.holding.soundness import require_one_clock
from crosspih_common.keys import (
    ABORT,
    CALIBRATE_FT,
    CLOCK,
    EVENTS,
    PHASE,
    RESET,
    TOUCH,
    TRUTH,
    WITHDRAW,
)
from crosspih_common.messages import (
    AbortAssembly,
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    CalibrateFt,
    Event,
    FtCalibration,
    Phase,
    PosePrior,
    ResetCell,
    Severity,
    SimulationTruth,
    Strategy,
    Touch,
    Withdraw,
    WithdrawResult,
)
from deploy.launcher.state import default_run_root
from services.operator.assembly.asked import ask_assembly
from services.operator.assembly.new_events import only_new
from services.operator.assembly.recorded import Kept, Recorded
from services.operator.cell.check.first import check_before_first
from services.operator.cell.which_cell import cell_path, endpoint
from services.operator.scoring.score import TrialFigures, score

NEEDED = ("hardware", "vision", "force_torque", "inference", "planning")
ASSEMBLY_DEADLINE_S = 900.0
WITHDRAW_DEADLINE_S = 300.0
RESET_DEADLINE_S = 120.0  # a busy machine builds a scene slowly
BACK_OFF_DEADLINE_S = 30.0
# who else is lost the planner says; of these two nobody else would
LOST = {
    "planning": Event(
        service="operator",
        severity=Severity.WARNING,
        code="service_lost",
        text="planning is gone: no sign of life from it (its liveliness token went)",
    ),
    "recorder": Event(
        service="operator",
        severity=Severity.WARNING,
        code="service_lost",
        text="the recorder is gone: nothing is recorded until it is back",
    ),
}


class Session:
    """The operator's place on the bus."""

    def __init__(self, connect_timeout_s: float = 5.0) -> None:
        self.cell: CellFile = load_cell(cell_path())
        self.bus = Bus(open_zenoh(endpoint(), connect_timeout_s), self.cell.workcell.name, "operator")
        self._alive: set[str] = set()
        self._recording = False
        self._on_lost: Callable[[Event], object] = lambda event: None
        self._changed = threading.Condition()
        self.bus.watch_alive(self._on_alive)
        self._truth = self.bus.latest(TRUTH)
        self._clock = self.bus.latest(CLOCK)
        self._phase = self.bus.latest(PHASE)
        # whoever comes late is told the last event of every service again
        self._told_before = self.bus.latest(EVENTS, 64)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exc: object) -> None:
        self.bus.close()

    def _on_alive(self, service: str, alive: bool) -> None:
        with self._changed:
            was_alive = service in self._alive
            (self._alive.add if alive else self._alive.discard)(service)
            self._changed.notify_all()
        if service in LOST and was_alive and not alive and (service != "recorder" or self._recording):
            self._on_lost(LOST[service])

    def alive(self) -> set[str]:
        """The services that live now."""
        with self._changed:
            return set(self._alive)

    def wait_for_services(self, deadline_s: float, needed: tuple[str, ...] = NEEDED) -> None:
        """Until all needed services live. Raises NoService naming the missing ones."""
        until = time.monotonic() + deadline_s
        with self._changed:
            while missing := [name for name in needed if name not in self._alive]:
                left = until - time.monotonic()
                if left <= 0.0:
                    raise NoService(
                        f"{', '.join(missing)}: not up after {deadline_s:g} s; see `crosspih ps` and `crosspih logs`"
                    )
                self._changed.wait(left)

    def speed(self) -> str:
        """How the running cell's clock runs: "realtime" or "max". Raises NoService when no clock is heard."""
        tick = self._clock.wait_for(lambda _: True, 5.0)
        if tick is None:
            raise NoService("clock: nobody publishes the cell's time; is hardware up? (`crosspih ps`)")
        return "realtime" if tick.realtime else "max"

    @property
    def simulated(self) -> bool:
        """Whether the running cell has a simulator, and so trials to reset and a truth. Raises NoService."""
        tick = self._clock.wait_for(lambda _: True, 5.0)
        if tick is None:
            raise NoService("clock: nobody publishes the cell's time; is hardware up? (`crosspih ps`)")
        return tick.simulated

    def require_sound_cell(self) -> None:
        """Before anything is asked of it: one clock ticks, one cell. Raises CommandRefused `cell_unfit`."""
        require_one_clock(self.bus)

    def require_checked_cell(self, say: Callable[[str], None] = lambda text: None) -> None:
        """Before the first assembly since the cell was started: the gentle part of `crosspih cell check`.

        `say` is told each of its steps. Raises CommandRefused `cell_unfit`, with what is wrong and how to mend it.
        """
        tick = self._clock.wait_for(lambda _: True, 5.0)
        if tick is not None:
            folder = default_run_root() / self.cell.workcell.name
            check_before_first(self.bus, self.cell.workcell, tick.boot_id, folder, say)

    def follow_events(
        self,
        on_phase: Callable[[AssemblyPhase], None],
        on_touch: Callable[[Touch], None],
        on_event: Callable[[Event], None],
    ) -> None:
        """Call with everything that happens from now on."""
        self.bus.subscribe(PHASE, on_phase)
        self.bus.subscribe(TOUCH, on_touch)
        self.bus.subscribe(EVENTS, only_new(on_event, self.bus.clock, self._told_before.values()))
        pump: Pump[Event] = Pump(on_event, 64, name="operator:lost", on_error=lambda error: None)
        self.bus.also_close(pump)
        self._on_lost = pump.offer

    def reset(self, command: ResetCell) -> SimulationTruth:
        """A new trial in the simulated cell."""
        return self.bus.call(RESET, command, RESET_DEADLINE_S)

    def calibrate_ft(self, samples_s: float, temperature_c: float | None = None) -> FtCalibration:
        """Drive the calibration poses and identify."""
        return self.bus.call(CALIBRATE_FT, CalibrateFt(samples_s=samples_s, temperature_c=temperature_c), 300.0)

    def withdraw(self, request: Withdraw) -> WithdrawResult:
        """Take the seated peg straight out."""
        return self.bus.call(WITHDRAW, request, WITHDRAW_DEADLINE_S)

    def abort(self) -> None:
        """End the running assembly."""
        self.bus.call(ABORT, AbortAssembly(), 5.0)

    def truth(self) -> SimulationTruth | None:
        """The simulator's truth as last heard; None on a real cell."""
        return self._truth.value()

    def _say_lost(self, text: str) -> None:
        self._on_lost(Event(service="operator", severity=Severity.WARNING, code="answer_lost", text=text))

    def trial(
        self,
        seed: int | None,
        strategy: Strategy,
        record: bool,
        on_begin: Callable[[int], None] = lambda now_ns: None,
        known: PosePrior | None = None,
        on_check: Callable[[str], None] = lambda text: None,
    ) -> tuple[TrialFigures, AssemblyResult]:
        """One assembly, scored: reset, record, assemble, stop recording. A cell without a simulator is not reset, and
        what needs its truth is left out of the figures.

        `on_begin` is called with the cell's time when the assembly starts. `known` is where the hole is, for the
        strategy known_pose. `on_check` is told each step of the first check of a cell that is not simulated.
        """
        truth: SimulationTruth | None = None
        if not self.simulated:
            seed = None
            self.require_checked_cell(on_check)
        if seed is not None:
            truth = self.reset(ResetCell(seed=seed))
        name = f"assembly-{strategy.value}" + ("" if seed is None else f"-seed{seed}")
        tape: Recorded | None = None
        if record:
            required = bool(self.cell.sections.get("recorder", {}).get("required"))
            tape = Recorded(self.bus, name, required)
            if tape.trouble:
                say = f"nothing is recorded: {tape.trouble}"
                self._on_lost(Event(service="operator", severity=Severity.WARNING, code="not_recorded", text=say))
        self._recording = tape is not None and not tape.trouble
        on_begin(self.bus.clock.now_ns())
        started = time.monotonic()
        try:
            request = Assemble(strategy=strategy, assembly_id=name, known=known)
            result = ask_assembly(self.bus, request, ASSEMBLY_DEADLINE_S, self._say_lost)
        except KeyboardInterrupt:
            # the planner takes the peg out; the stack must live until it has
            began_ns = self.bus.clock.now_ns()
            self.abort()
            self._phase.wait_for(
                lambda phase: phase.phase is Phase.DONE and phase.stamp_ns >= began_ns, BACK_OFF_DEADLINE_S
            )
            raise
        finally:
            wall_s = time.monotonic() - started
            self._recording = False
            kept = Kept() if tape is None else tape.end()
        if truth is not None:
            # the peg's pose at the end, not at the reset
            now_ns = self.bus.clock.now_ns()
            latest = self._truth.wait_for(lambda sample: sample.stamp_ns >= now_ns, 2.0)
            truth = latest or self._truth.value() or truth
        figures = score(self.cell.workcell, result, truth, wall_s=wall_s, recording=kept.path)
        return figures.model_copy(update={"recording_parts": kept.parts, "recording_warnings": kept.warnings}), result
