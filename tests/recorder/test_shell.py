"""The recorder on a bus in memory: what it taps, what it rejects, what it counts."""

from __future__ import annotations

from pathlib import Path

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import load_cell
from crosspih_common.keys import EVENTS, PHASE, RECORD_START, RECORD_STOP, STATUS
from crosspih_common.messages import (
    AssemblyPhase,
    Event,
    Phase,
    ServiceState,
    ServiceStatus,
    Severity,
    StartRecording,
    StopRecording,
)
from crosspih_common.recording import read_recording
from crosspih_common.service.lifecycle import ServiceContext
from services.recorder.config import RecorderConfig
from services.recorder.shell import RecorderShell


def status(service: str) -> ServiceStatus:
    return ServiceStatus(service=service, state=ServiceState.READY, pid=1, uptime_s=1.0)


def test_a_recording_over_a_bus_in_memory(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text("cell: {name: m}\n")
    hub = MemoryHub()
    cell = load_cell(tmp_path / "cell.yaml")
    with (
        Bus(hub.transport(), "m", "recorder") as bus,
        Bus(hub.transport(), "m", "planning") as planning,
        Bus(hub.transport(), "m", "vision") as vision,
    ):
        context = ServiceContext("recorder", cell, bus)
        shell = RecorderShell(context, RecorderConfig(directory=tmp_path / "r", quiet_s=0.01, flush_s=10.0))
        started = planning.call(RECORD_START, StartRecording(name="m"), 10.0)
        planning.publisher(STATUS).publish(status("planning"))
        vision.publisher(STATUS).publish(status("vision"))
        vision.publisher(EVENTS).publish(Event(service="vision", severity=Severity.INFO, code="c", text="t"))
        phases = planning.publisher(PHASE)
        phases.publish(AssemblyPhase(assembly_id="a", phase=Phase.PUSHING, text="x"))
        # the planner's own samples on the same key: another type, an old version, and the right label over nonsense
        raw = planning._transport.sender(PHASE.key("m"), recover=False, history=0)
        raw.put(b"{}", "crosspih.Touch/1 1")
        raw.put(b"{}", "crosspih.AssemblyPhase/0 1")
        raw.put(b"nonsense", "crosspih.AssemblyPhase/1 1")
        stopped = planning.call(RECORD_STOP, StopRecording(), 10.0)
        rejected = {row.key: row.rejected for row in bus.traffic.snapshot() if row.rejected}
        shell.close()
    assert started.recording and not stopped.recording and stopped.path == started.path
    assert rejected == {PHASE.key("m"): 3}
    assert stopped.dropped == {PHASE.key("m"): 1}  # what had the right label counts as lost from the file
    recording = read_recording(started.path)
    assert sorted(recording.keys_of(STATUS)) == [
        "crosspih/m/service/planning/status",
        "crosspih/m/service/vision/status",
    ]
    assert [message.service for message in recording.messages(STATUS)] == ["planning", "vision"]
    assert recording.keys_of(EVENTS) == ["crosspih/m/service/vision/event"]
    assert len(recording.messages(PHASE)) == 1 and recording.problems == []
    assert len(recording.messages(RECORD_STOP.request_echo)) == 1
    assert recording.metadata["drops"][f"malformed {PHASE.key('m')}"] == "1"
    assert recording.schemas["crosspih/m/planning/phase"] == ("crosspih.AssemblyPhase", "json")
