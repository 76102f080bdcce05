"""The client of a running cell: `with connect() as cell: cell.assemble(seed=7)`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar, overload

from crosspih_common.bus import Bus, Latest
from crosspih_common.bus.workers import Pump
from crosspih_common.client.assembly_request import ask_assembly
from crosspih_common.client.checked import require_checked
from crosspih_common.client.new_events import only_new
from crosspih_common.client.outcomes import Assembly, CellStatus
from crosspih_common.client.running_recording import FinishedRecording, RunningRecording
from crosspih_common.client.streaming import DEPTH, Stream
from crosspih_common.config import CellFile, Workcell
from crosspih_common.errors import ConfigError, NoService
from crosspih_common.holding.soundness import require_one_clock
from crosspih_common.keys import (
    ABORT,
    CALIBRATE_FT,
    CLOCK,
    CONTACT_WRENCH,
    EVENTS,
    JOINT_STATE,
    LEASE,
    LOCATE,
    PAUSE,
    PHASE,
    RESET,
    STATUS,
    TOUCH,
    WITHDRAW,
    Payload,
    Topic,
)
from crosspih_common.messages import (
    AbortAssembly,
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    CalibrateFt,
    CellClock,
    ContactWrench,
    Event,
    FtCalibration,
    HoleEstimate,
    JointState,
    LeaseState,
    LocateHole,
    LocateMethod,
    PauseAssembly,
    Phase,
    PosePrior,
    ResetCell,
    ServiceStatus,
    Severity,
    Strategy,
    Touch,
    Withdraw,
    WithdrawResult,
    strategy_of,
)
from crosspih_common.topic_names import topic_named

PayloadT = TypeVar("PayloadT", bound=Payload)

NEEDED = ("hardware", "vision", "force_torque", "inference", "planning")
ASSEMBLY_DEADLINE_S = 900.0
WITHDRAW_DEADLINE_S = 300.0
CALIBRATE_DEADLINE_S = 300.0
LOCATE_DEADLINE_S = 120.0
ANSWER_DEADLINE_S = 5.0
RESET_DEADLINE_S = 120.0  # a busy machine builds a scene slowly
BACK_OFF_DEADLINE_S = 30.0
CLOCK_DEADLINE_S = 5.0
READING_DEADLINE_S = 2.0
# the planner reports other lost services; nobody reports the loss of these two
LOST = {
    "planning": "planning is gone: no sign of life from it (its liveliness token went)",
    "recorder": "the recorder is gone: nothing is recorded until it is back",
}


class Cell:
    """A connection to the bus of a running cell; `connect` opens one. The end of its block, or `close`, closes it.

    It sends the same commands to the same services as `crosspih` on the command line: an arm that somebody else holds
    is not moved (CommandRefused `held` or `busy`), and planning finishes an assembly whose client ends without notice.
    Lengths are m, angles rad, forces N, moments Nm, times s, unless a name says otherwise.
    """

    def __init__(self, bus: Bus, file: CellFile, *, readings: bool = False) -> None:
        """`readings`: subscribe to wrench and joints from the start, so that `wrench` and `joints` answer at once."""
        self.bus, self.file = bus, file
        self._alive: set[str] = set()
        self._recording = False
        self._asking = False  # an assembly of this client's own is under way
        self._on_lost: Callable[[Event], object] = lambda event: None
        self._changed = threading.Condition()
        self.bus.watch_alive(self._on_alive)
        self._clock = self.bus.latest(CLOCK)
        self._phase = self.bus.latest(PHASE)
        # a late subscriber receives the last event of every service again
        self._told_before = self.bus.latest(EVENTS, 64)
        self._wrench: Latest[ContactWrench] | None = self.bus.latest(CONTACT_WRENCH) if readings else None
        self._joints: Latest[JointState] | None = self.bus.latest(JOINT_STATE) if readings else None

    def __enter__(self) -> Cell:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection to the bus. Safe to call twice."""
        self.bus.close()

    @property
    def workcell(self) -> Workcell:
        """The nominal cell: arm, peg, hole and their poses, as the cell's file gives them."""
        return self.file.workcell

    # ----------------------------------------------------------------------------------------------------- who is there

    def _on_alive(self, service: str, alive: bool) -> None:
        with self._changed:
            was_alive = service in self._alive
            (self._alive.add if alive else self._alive.discard)(service)
            self._changed.notify_all()
        if service in LOST and was_alive and not alive and (service != "recorder" or self._recording):
            self._warn("service_lost", LOST[service])

    def _warn(self, code: str, text: str) -> None:
        self._on_lost(Event(service=self.bus.service, severity=Severity.WARNING, code=code, text=text))

    def alive(self) -> set[str]:
        """The services that live now."""
        with self._changed:
            return set(self._alive)

    def wait_for_services(self, deadline_s: float, needed: tuple[str, ...] = NEEDED) -> None:
        """Wait until all needed services live. Raises NoService that names the missing ones."""
        until = time.monotonic() + deadline_s
        with self._changed:
            while missing := [name for name in needed if name not in self._alive]:
                left = until - time.monotonic()
                if left <= 0.0:
                    raise NoService(
                        f"{', '.join(missing)}: not up after {deadline_s:g} s; see `crosspih ps` and `crosspih logs`"
                    )
                self._changed.wait(left)

    def clock(self) -> CellClock:
        """The newest tick of the cell's clock. Raises NoService if none arrives within 5 s."""
        tick = self._clock.wait_for(lambda _: True, CLOCK_DEADLINE_S)
        if tick is None:
            raise NoService("clock: nobody publishes the cell's time; is hardware up? (`crosspih ps`)")
        return tick

    def speed(self) -> str:
        """How the running cell's clock runs: "realtime" or "max". Raises NoService when no clock is heard."""
        return "realtime" if self.clock().realtime else "max"

    @property
    def simulated(self) -> bool:
        """Whether the running cell has a simulator, and so trials to reset. Raises NoService."""
        return self.clock().simulated

    def require_sound_cell(self) -> None:
        """Check that exactly one cell runs here, with one clock. Raises CommandRefused `cell_unfit`."""
        require_one_clock(self.bus)

    def status(self) -> CellStatus:
        """The state of the cell and the holder of its arm, by each service's last status. Waits 2 s at most."""
        with self.bus.reading(STATUS, 64) as heard, self.bus.reading(LEASE) as lease:
            until = time.monotonic() + READING_DEADLINE_S
            services: dict[str, ServiceStatus] = {}
            while time.monotonic() < until:
                heard.wait_for(lambda said: said.service not in services, max(until - time.monotonic(), 0.0))
                services.update({said.service: said for said in heard.values()})
                if self.alive() & set(NEEDED) <= set(services):
                    break
            held: LeaseState | None = lease.wait_for(lambda _: True, max(until - time.monotonic(), 0.05))
        tick = self.clock()
        return CellStatus(
            cell=self.bus.cell,
            endpoint=self.bus.endpoint or "",
            simulated=tick.simulated,
            speed="realtime" if tick.realtime else "max",
            alive=frozenset(self.alive()),
            services=services,
            holder="" if held is None else held.holder,
            holding_for="" if held is None else held.purpose,
        )

    # -------------------------------------------------------------------------------------------------------- listening

    def follow_events(
        self,
        on_phase: Callable[[AssemblyPhase], None],
        on_touch: Callable[[Touch], None],
        on_event: Callable[[Event], None],
    ) -> None:
        """Call with every phase, touch and event from now on, each kind on a thread of its own."""
        self.bus.subscribe(PHASE, on_phase)
        self.bus.subscribe(TOUCH, on_touch)
        self.bus.subscribe(EVENTS, only_new(on_event, self.bus.clock, self._told_before.values()))
        pump: Pump[Event] = Pump(on_event, 64, name=f"{self.bus.service}:lost", on_error=lambda error: None)
        self.bus.also_close(pump)
        self._on_lost = pump.offer

    @overload
    def stream(self, topic: Topic[PayloadT], depth: int = ..., timeout_s: float | None = ...) -> Stream[PayloadT]: ...

    @overload
    def stream(self, topic: str, depth: int = ..., timeout_s: float | None = ...) -> Stream[Any]: ...

    def stream(self, topic: Topic[Any] | str, depth: int = DEPTH, timeout_s: float | None = None) -> Stream[Any]:
        """The samples of a topic as they come: `with cell.stream("force_torque/wrench") as stream: for message in
        stream`.

        `topic` is a row of crosspih_common/keys.py (then the messages are typed) or its path; `depth` and `timeout_s`
        as in Stream. A topic that keeps its last sample for late readers begins with that sample.

        Raises ConfigError for a path that is not a topic, or a topic that only the recorder may read.
        """
        row = topic_named(topic, self.bus.service)
        return Stream(row.path, lambda push: self.bus.subscribed(row, push), depth, timeout_s, lambda: self.bus.closed)

    def events(self, depth: int = DEPTH, timeout_s: float | None = None) -> Stream[Event]:
        """Events for people, from now on. Earlier events, which a late reader receives again, are left out."""

        def listen(push: Callable[[Event], None]) -> Any:
            return self.bus.subscribed(EVENTS, only_new(push, self.bus.clock, self._told_before.values()))

        return Stream(EVENTS.path, listen, depth, timeout_s, lambda: self.bus.closed)

    def wrench(self, timeout_s: float = READING_DEADLINE_S) -> ContactWrench:
        """The newest contact wrench: `force_n` (3,) and `moment_nm` (3,) on the peg, in the peg frame about its origin.

        Raises NoService if none arrives within `timeout_s`. At --speed max the cell's time stands still between
        commands: the wrench is then the one at the end of the last command.
        """
        if self._wrench is None:
            self._wrench = self.bus.latest(CONTACT_WRENCH)
        return _newest(self._wrench, CONTACT_WRENCH, timeout_s)

    def joints(self, timeout_s: float = READING_DEADLINE_S) -> JointState:
        """The newest joint state: `joints_rad` and `speeds_rad_s`, motor-side, one number a joint from base to flange.

        Raises NoService, as `wrench`.
        """
        if self._joints is None:
            self._joints = self.bus.latest(JOINT_STATE)
        return _newest(self._joints, JOINT_STATE, timeout_s)

    # ------------------------------------------------------------------------------------------------------- commanding

    def reset(self, seed: int) -> None:
        """A new trial in a simulated cell: hole, light and noise drawn from the seed, the arm at home.

        Only the simulator knows what was drawn; a recording holds it (`simulation/truth`). Raises ConfigError on a cell
        without a simulator.
        """
        if not self.simulated:
            raise ConfigError(f"{self.bus.cell}: this cell has no simulator: nothing is drawn; leave the seed out")
        self.bus.call(RESET, ResetCell(seed=seed), RESET_DEADLINE_S)

    def locate(self, method: LocateMethod | str = LocateMethod.RIM) -> HoleEstimate:
        """Take a stereo pair and locate the hole: its pose in the base frame, with its covariance.

        Nothing moves. Raises CommandRefused with vision's reason if it does not find the hole.
        """
        return self.bus.call(LOCATE, LocateHole(method=LocateMethod(method)), LOCATE_DEADLINE_S)

    def calibrate_ft(self, samples_s: float = 0.25, temperature_c: float | None = None) -> FtCalibration:
        """Drive the calibration poses, dwell `samples_s` in each, and identify the sensor's bias and payload."""
        return self.bus.call(
            CALIBRATE_FT, CalibrateFt(samples_s=samples_s, temperature_c=temperature_c), CALIBRATE_DEADLINE_S
        )

    def withdraw(self, request: Withdraw | None = None) -> WithdrawResult:
        """Take the seated peg straight out along its own axis, slowly, stopping where it resists."""
        return self.bus.call(WITHDRAW, request or Withdraw(), WITHDRAW_DEADLINE_S)

    def abort(self) -> bool:
        """End the running assembly, whoever asked for it: planning takes the peg out. True if one was running."""
        return self.bus.call(ABORT, AbortAssembly(), ANSWER_DEADLINE_S).was_running

    def pause(self) -> bool:
        """Pause the running assembly: the motion under way is finished, and the arm then stays where it is. True if one
        was running."""
        return self.bus.call(PAUSE, PauseAssembly(paused=True), ANSWER_DEADLINE_S).was_running

    def resume(self) -> bool:
        """Resume a paused assembly. True if one was running."""
        return self.bus.call(PAUSE, PauseAssembly(paused=False), ANSWER_DEADLINE_S).was_running

    def assemble(
        self,
        seed: int | None = None,
        strategy: Strategy | str = Strategy.FUSED,
        *,
        known: PosePrior | None = None,
        record: bool = True,
        name: str | None = None,
        deadline_s: float = ASSEMBLY_DEADLINE_S,
        on_begin: Callable[[int], None] = lambda now_ns: None,
    ) -> Assembly:
        """One assembly, to its end: the peg is in, or `result.failure` says why not and the peg was taken out again.

        `seed` first draws a new trial in a simulated cell; None takes the cell as it stands. `known` is where the hole
        is, for the strategy known_pose. `strategy` may be your own, as module:Class (docs/extending.md).
        `record` writes a recording, under `name` where that is given. `on_begin` is
        called with the cell's time, ns, as it begins. Ctrl-C ends the assembly: planning takes the peg out, which is
        waited for.

        Raises CommandRefused where planning does not begin it, such as `busy`, `held` and `cell_unfit`; ConfigError for
        a seed without a simulator; and as `Bus.call`.
        """
        if seed is not None:
            self.reset(seed)
        elif not self.simulated:
            require_checked(self.bus.cell, self.clock().boot_id)
        said = strategy.value if isinstance(strategy, Strategy) else strategy
        name = name or f"assembly-{said}" + ("" if seed is None else f"-seed{seed}")
        request = Assemble(strategy=strategy_of(said), assembly_id=name, known=known)
        tape: RunningRecording | None = None
        if record:
            required = bool(self.file.sections.get("recorder", {}).get("required"))
            tape = RunningRecording(self.bus, name, required)
            if tape.trouble:
                self._warn("not_recorded", f"nothing is recorded: {tape.trouble}")
        self._recording = tape is not None and not tape.trouble
        on_begin(self.bus.clock.now_ns())
        started = time.monotonic()
        try:
            result = self._asked_for(request, deadline_s)
        finally:
            wall_s = time.monotonic() - started
            self._recording = False
            kept = FinishedRecording() if tape is None else tape.end()
        return Assembly(
            result=result,
            seed=seed,
            wall_s=wall_s,
            recording=None if kept.path is None else Path(kept.path),
            recording_parts=tuple(Path(part) for part in kept.parts),
            recording_warnings=kept.warnings,
        )

    def _asked_for(self, request: Assemble, deadline_s: float) -> AssemblyResult:
        self._asking = True
        try:
            return ask_assembly(self.bus, request, deadline_s, lambda text: self._warn("answer_lost", text))
        except KeyboardInterrupt:
            # the planner takes the peg out; the stack must live until that is done
            began_ns = self.bus.clock.now_ns()
            self.abort()
            self._phase.wait_for(
                lambda phase: phase.phase is Phase.DONE and phase.stamp_ns >= began_ns, BACK_OFF_DEADLINE_S
            )
            raise
        finally:
            self._asking = False

    def abort_own(self) -> bool:
        """As `abort`, but only for an assembly that this client asked for. True if it was running."""
        return self._asking and self.abort()


def _newest(latest: Latest[PayloadT], topic: Topic[PayloadT], timeout_s: float) -> PayloadT:
    found = latest.wait_for(lambda _: True, timeout_s)
    if found is None:
        raise NoService(
            f"{topic.path}: nothing was heard within {timeout_s:g} s; is {topic.publisher} up (`crosspih ps`)? At "
            "--speed max nothing is said until the first command"
        )
    return found


__all__ = ["NEEDED", "Cell"]
