"""The client on the real simulated cell and the real services, over the bus in memory."""

from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.client import AsyncCell, Cell, connect
from crosspih_common.config import load_cell
from crosspih_common.errors import BusUnreachable, CommandRefused, CommandTimeout, ConfigError, NoService
from crosspih_common.keys import CLOCK, CONTACT_WRENCH, EVENTS, PHASE, TOUCH
from crosspih_common.messages import AssemblyPhase, AssemblyResult, CellClock, Event, Failure, Phase, Severity, Touch
from tests.planning.cell_in_memory import CellInMemory

DEADLINE_S = 60.0
SEED = 7


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CellInMemory]:
    cell = CellInMemory(tmp_path_factory.mktemp("cell"))
    yield cell
    cell.close()


@pytest.fixture
def cell(running: CellInMemory) -> Iterator[Cell]:
    running.on_phase = lambda phase: None
    with Cell(running.context("operator").bus, running.cell, readings=True) as opened:
        yield opened


def phase(text: str) -> AssemblyPhase:
    return AssemblyPhase(assembly_id="a", phase=Phase.PUSHING, text=text)


def test_an_assembly_is_asked_for_and_the_streams_tell_of_it(cell: Cell) -> None:
    begun: list[int] = []
    with (
        cell.stream(PHASE) as phases,
        cell.stream("planning/touch") as touches,
        cell.stream(CONTACT_WRENCH) as wrenches,
    ):
        done = cell.assemble(seed=SEED, record=False, on_begin=begun.append)
        told = [one for one in phases.take_all() if one.stamp_ns >= begun[0]]
        felt: list[Touch] = [one for one in touches.take_all() if one.stamp_ns >= begun[0]]
        heard = wrenches.take_all()
    assert done.inserted and done.seed == SEED and done.recording is None and done.wall_s > 0.0
    assert told[-1].phase is Phase.DONE and {one.phase for one in told} >= {Phase.LOCATING, Phase.SEATED}
    assert len(felt) == done.result.touches + done.result.presses
    assert cell.wrench() == heard[-1] and heard[-1].force_n + heard[-1].moment_nm == heard[-1].wrench
    assert len(cell.joints().joints_rad) == 6
    where, seen = done.result.pose_base_hole, cell.locate().pose_base_hole
    assert where is not None and where.pose().distance_to_m(seen.pose()) < 1e-3
    out = cell.withdraw()
    assert out.withdrawn and out.distance_m > 0.02


def test_nobody_elses_assembly_is_disturbed(running: CellInMemory, cell: Cell) -> None:
    """A second client is refused, and the first one's assembly goes on when its client is gone without a word."""
    cell.reset(SEED)
    pushing, refused = threading.Event(), threading.Event()

    def on_phase(told: AssemblyPhase) -> None:
        if told.phase is Phase.PUSHING and not pushing.is_set():
            pushing.set()
            assert refused.wait(DEADLINE_S)

    running.on_phase = on_phase
    first = Cell(Bus(running.hub.transport(), cell.bus.cell, "operator"), running.cell)
    ended: list[AssemblyResult | Exception] = []

    def ask() -> None:
        try:
            ended.append(first.assemble(record=False, name="assembly-first").result)
        except Exception as error:
            ended.append(error)

    asking = threading.Thread(target=ask)
    with cell.stream(PHASE) as phases:
        asking.start()
        assert pushing.wait(DEADLINE_S)
        for command in (lambda: cell.assemble(record=False), cell.withdraw):
            with pytest.raises(CommandRefused) as why:
                command()
            assert why.value.code == "busy"
        first.close()
        refused.set()
        last = next(told for told in phases if told.phase is Phase.DONE and told.assembly_id == "assembly-first")
    asking.join(DEADLINE_S)
    assert last.text == "inserted" and not asking.is_alive()


def test_a_cancelled_assembly_is_ended_and_the_peg_is_out(running: CellInMemory, cell: Cell) -> None:
    async def cancelled() -> list[AssemblyPhase]:
        async with AsyncCell(Cell(running.context("operator").bus, running.cell)) as twin, twin.stream(PHASE) as phases:
            await twin.reset(SEED)
            assembling = asyncio.create_task(twin.assemble(record=False, name="cancelled"))
            told: list[AssemblyPhase] = []
            async for one in phases:
                if one.assembly_id != "cancelled":
                    continue  # the last of before, told once more
                told.append(one)
                if one.phase is Phase.PUSHING:
                    assembling.cancel()
                if one.phase is Phase.DONE:
                    break
            with pytest.raises(asyncio.CancelledError):
                await assembling
            return told

    told = asyncio.run(cancelled())
    assert told[-1].text.startswith(f"failed: {Failure.ABORTED.value}")
    assert any(one.phase is Phase.BACKING_OFF for one in told)
    assert cell.abort() is False


def test_what_a_cell_can_be_asked_can_be_awaited() -> None:
    def asked(kind: type) -> set[str]:
        return {name for name in vars(kind) if not name.startswith("_")}

    assert asked(Cell) - asked(AsyncCell) == {"bus", "follow_events", "abort_own"} & asked(Cell)
    assert inspect.getdoc(AsyncCell.assemble.__get__(None, AsyncCell)) == inspect.getdoc(Cell.assemble)  # type: ignore[arg-type]


# ----------------------------------------------------------------------------------------------------------- streams


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def alone(hub: MemoryHub) -> Iterator[Cell]:
    """A client of a bus on which nobody else is."""
    file = load_cell("deploy/cells/default.yaml")
    with Cell(Bus(hub.transport(), "cell1", "operator"), file) as opened:
        yield opened


def test_a_slow_reader_gets_the_newest_and_is_told_how_many_it_missed(hub: MemoryHub, alone: Cell) -> None:
    with Bus(hub.transport(), "cell1", "planning") as planning, alone.stream(PHASE, depth=3) as stream:
        for number in range(8):
            planning.publisher(PHASE).publish(phase(str(number)))
        assert stream.dropped == 5
        texts = []
        for told in stream:
            texts.append(told.text)
            if len(texts) == 2:
                break
        assert texts == ["5", "6"] and [told.text for told in stream.take_all()] == ["7"]
        threading.Timer(0.05, stream.close).start()
        assert list(stream) == []


def test_a_silent_topic_ends_a_loop_by_name(alone: Cell) -> None:
    with alone.stream(TOUCH, timeout_s=0.05) as stream, pytest.raises(CommandTimeout, match="planning/touch: nothing"):
        next(iter(stream))
    with pytest.raises(NoService, match="force_torque/wrench: nothing was heard"):
        alone.wrench(0.05)


def test_only_news_is_an_event(hub: MemoryHub, alone: Cell) -> None:
    def event(code: str) -> Event:
        return Event(service="vision", severity=Severity.INFO, code=code, text="t")

    with Bus(hub.transport(), "cell1", "vision") as vision:
        vision.publisher(EVENTS).publish(event("old"))
        with alone.events() as events:
            vision.publisher(EVENTS).publish(event("new"))
            assert [one.code for one in events.take_all()] == ["new"]


def test_the_samples_of_one_service_are_had_by_its_own_path(hub: MemoryHub, alone: Cell) -> None:
    one, everybody = alone.stream("service/vision/event"), alone.stream("service/*/event")
    with one, everybody:
        for service in ("vision", "planning"):
            with Bus(hub.transport(), "cell1", service) as bus:
                said = Event(service=service, severity=Severity.INFO, code="c", text="t")
                bus.publisher(EVENTS).publish(said)
        assert [event.service for event in one.take_all()] == ["vision"]
        assert {event.service for event in everybody.take_all()} == {"vision", "planning"}


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("force_torqe/wrench", "did you mean force_torque/wrench"),
        ("zzz", "`crosspih keys` lists them all"),
        ("arm/dwell/request", "only recorder may read it; a recording has it"),
    ],
)
def test_a_topic_that_cannot_be_streamed_is_named(alone: Cell, path: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        alone.stream(path)


# ------------------------------------------------------------------------------------------------------ what is refused


def test_a_cell_without_a_simulator_is_asked_for_nothing_before_its_check(
    hub: MemoryHub, alone: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CROSSPIH_RUN_DIR", str(tmp_path))
    with Bus(hub.transport(), "cell1", "hardware") as hardware:
        hardware.publisher(CLOCK).publish(CellClock(stamp_ns=1, boot_id="b", realtime=True))
        with pytest.raises(CommandRefused, match="`crosspih cell check` does it"):
            alone.assemble()
        with pytest.raises(ConfigError, match="no simulator: nothing is drawn"):
            alone.assemble(seed=1)


def test_where_no_stack_runs_one_line_says_what_to_do() -> None:
    with pytest.raises(BusUnreachable, match="start the stack with `crosspih up`") as why:
        connect("tcp/127.0.0.1:1", timeout_s=0.2)
    assert "\n" not in str(why.value) and "/root" not in str(why.value)
