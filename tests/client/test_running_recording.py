"""The recording of an assembly as the operator asks for it: the real recorder on a bus in memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.bus.clock import BusClock
from crosspih_common.client import running_recording
from crosspih_common.client.new_events import only_new
from crosspih_common.client.running_recording import RunningRecording
from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused, NoService
from crosspih_common.keys import CLOCK, PHASE
from crosspih_common.messages import AssemblyPhase, CellClock, Event, Phase, Severity
from crosspih_common.recording import read_recording
from crosspih_common.service.lifecycle import ServiceContext
from services.recorder.config import RecorderConfig
from services.recorder.shell import RecorderShell


@contextmanager
def recorder(hub: MemoryHub, folder: Path, required: bool = False) -> Iterator[ServiceContext]:
    """As `python -m services.recorder` builds it; leaving the block is its SIGTERM."""
    (folder / "cell.yaml").write_text("cell: {name: m}\n")
    with Bus(hub.transport(), "m", "recorder") as bus:
        context = ServiceContext("recorder", load_cell(folder / "cell.yaml"), bus)
        config = RecorderConfig(directory=folder / "r", quiet_s=0.01, required=required)
        shell = RecorderShell(context, config)
        yield context
        shell.close()


def say(bus: Bus, text: str) -> None:
    bus.publisher(PHASE).publish(AssemblyPhase(assembly_id="a", phase=Phase.PUSHING, text=text))


def test_a_recorder_that_is_started_again_goes_on_and_the_result_names_all_files(tmp_path: Path) -> None:
    hub = MemoryHub()
    buses = (Bus(hub.transport(), "m", name) for name in ("hardware", "operator", "planning"))
    with ExitStack() as stack:
        hardware, operator, planning = (stack.enter_context(bus) for bus in buses)
        hardware.publisher(CLOCK).publish(CellClock(stamp_ns=5, boot_id="b", realtime=True))
        with recorder(hub, tmp_path):
            tape = RunningRecording(operator, "twice", required=True)
            say(planning, "before")
        say(planning, "while nobody listens")
        with recorder(hub, tmp_path) as context:
            say(planning, "after")
            kept = tape.end()
            assert context.last_error.startswith("recording_resumed")
    assert tape.trouble == ""
    assert [Path(part).name for part in kept.parts] == ["twice-0001.mcap", "twice-0001.part2.mcap"]
    assert kept.path == kept.parts[0]
    assert any("the recorder was gone for" in warning for warning in kept.warnings)
    told = [phase.text for phase in read_recording(kept.path).messages(PHASE)]
    # a bus keeps the last event for whoever comes late
    assert told == ["before", "while nobody listens", "after"]


def test_without_a_recorder_the_assembly_is_done_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running_recording, "BACK_S", 0.0)
    hub = MemoryHub()
    with Bus(hub.transport(), "m", "operator") as operator:
        tape = RunningRecording(operator, "none", required=False)
        assert "nobody answers" in tape.trouble
        assert tape.end().path is None and "nothing was recorded" in tape.end().warnings[0]
        with pytest.raises(NoService):
            RunningRecording(operator, "none", required=True)
        with recorder(hub, tmp_path):
            tape = RunningRecording(operator, "gone", required=False)
        kept = tape.end()
    assert kept.path is not None and kept.parts == (kept.path,)
    assert "the recorder is gone" in kept.warnings[0]


def test_a_disk_that_takes_nothing(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("a file where the directory should be")
    hub = MemoryHub()
    with Bus(hub.transport(), "m", "operator") as operator:
        with recorder(hub, tmp_path) as context:
            tape = RunningRecording(operator, "x", required=False)
            assert "recorder.directory" in tape.trouble
            assert context.status().reason.startswith("nothing is recorded: cannot make a file")
            assert tape.end().path is None and tape.end().warnings == (f"nothing was recorded: {tape.trouble}",)
        with recorder(hub, tmp_path, required=True), pytest.raises(CommandRefused, match="unwritable"):
            RunningRecording(operator, "x", required=False)


def event(stamp_ns: int, seq: int = 0) -> Event:
    return Event(
        stamp_ns=stamp_ns, seq=seq, service="recorder", severity=Severity.ERROR, code="recording_failed", text="full"
    )


def test_events_of_before_are_not_told_again() -> None:
    clock = BusClock()
    clock.observe(10_000_000_000, "now")
    told: list[Event] = []
    hear = only_new(told.append, clock, [event(10_000_000_000, seq=3)])
    hear(event(9_999_999_999))  # before this session
    hear(event(10_000_000_000, seq=3))  # heard already, and the clock stood still since
    hear(event(3_600_000_000_000))  # of the run of the cell before, which had been up for an hour
    assert told == []
    news = [event(10_000_000_000, seq=4), event(-1), event(10_500_000_000, seq=5)]
    for one in news:
        hear(one)
    assert told == news
    clock.observe(1_000_000, "restarted")  # the cell was started again: its clock begins anew
    hear(event(2_000_000, seq=0))
    assert told[-1].stamp_ns == 2_000_000
