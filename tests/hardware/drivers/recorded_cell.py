"""A short recording of the real simulated cell by the real recorder, and cells that play recordings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from numpy.typing import NDArray

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import Workcell, load_cell
from crosspih_common.geometry import Pose
from crosspih_common.holding import ArmLease, hold_arm
from crosspih_common.keys import (
    CAPTURE,
    DWELL,
    GUARDED_MOVE,
    MOVE_LINEAR,
    RECORD_START,
    RECORD_STOP,
    RESET,
    SET_PAYLOAD,
)
from crosspih_common.messages import (
    CaptureStereo,
    Dwell,
    GuardedMove,
    MotionOutcome,
    MoveLinear,
    PoseData,
    ResetCell,
    SetPayload,
    StartRecording,
    StereoPair,
    StopRecording,
)
from crosspih_common.recording import Recording, read_recording
from crosspih_common.service.lifecycle import ServiceContext
from services.hardware.__main__ import build
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.config import SimulatedSensorConfig
from services.recorder.config import RecorderConfig
from services.recorder.shell import RecorderShell

DEADLINE_S = 60.0
SIMULATED = {"driver": "simulated", "simulated": {"speed": "max", "camera": {"samples": 1}}}
CELL: dict[str, Any] = {"name": "film", "camera": {"width_px": 160, "height_px": 120, "cx_px": 80.5, "cy_px": 60.5}}
# across from the hole, the tip 30 mm in front of the plate
BESIDE_THE_HOLE = PoseData.of(Pose.from_translation([0.02, 0.02, -Workcell().peg.shape().tip_m - 0.03]))
FT = SimulatedSensorConfig()
PAYLOAD = SetPayload(
    bias=FT.bias, weight_n=9.81 * FT.payload_kg, centroid_ft_m=FT.payload_centroid_m, gravity_base=(0.0, 0.0, -1.0)
)


@dataclass(frozen=True)
class Played:
    """What a session was answered, and what the recorder heard of it."""

    outcomes: list[MotionOutcome]
    pair: StereoPair
    recording: Recording


@contextmanager
def running(folder: Path, hardware: dict[str, Any], cell: dict[str, Any] = CELL) -> Iterator[tuple[Bus, ArmLease]]:
    """The hardware service and the recorder in this process, time standing between commands; the arm is held."""
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump({"cell": cell, "hardware": hardware}), encoding="utf-8")
    loaded, hub = load_cell(path), MemoryHub()
    name = loaded.workcell.name
    with (
        Bus(hub.transport(), name, "hardware") as bus,
        Bus(hub.transport(), name, "recorder") as recording,
        Bus(hub.transport(), name, "operator") as asking,
    ):
        recorder = RecorderShell(
            ServiceContext("recorder", loaded, recording), RecorderConfig(directory=folder / "r", quiet_s=0.01)
        )
        shell = build(ServiceContext("hardware", loaded, bus), loaded.section("hardware", HardwareConfig), None)
        try:
            with hold_arm(asking, "a test") as lease:
                yield asking, lease
        finally:
            shell.close()
            recorder.close()


def session(bus: Bus, lease: ArmLease, name: str) -> Played:
    """Dwell, take a pair, drive a way, touch the plate; recorded."""
    started = bus.call(RECORD_START, StartRecording(name=name), DEADLINE_S)
    first = lease.ask(DWELL, Dwell(duration_s=0.05), DEADLINE_S)
    pair = bus.call(CAPTURE, CaptureStereo(exposure_scale=2.0), DEADLINE_S)
    start = first.pose_base_peg.pose()
    into = start.rotation[:, 2]
    goal = PoseData.of(Pose(start.rotation, start.translation_m + 0.01 * into))
    along = lease.ask(MOVE_LINEAR, MoveLinear(pose_base_peg=goal), DEADLINE_S)
    lease.ask(SET_PAYLOAD, PAYLOAD, DEADLINE_S)
    touch = lease.ask(
        GUARDED_MOVE,
        GuardedMove(direction_base=tuple(into.tolist()), speed_m_s=0.02, travel_limit_m=0.03, retreat_m=0.002),
        DEADLINE_S,
    )
    # the last samples of a recording wait for a batch that is never full: nothing above may need them
    lease.ask(DWELL, Dwell(duration_s=0.05), DEADLINE_S)
    bus.call(RECORD_STOP, StopRecording(), DEADLINE_S)
    return Played([first, along, touch], pair, read_recording(started.path))


def record_simulated(folder: Path) -> Played:
    """The session in the simulated cell."""
    with running(folder, SIMULATED) as (bus, lease):
        bus.call(RESET, ResetCell(seed=3, offset_hole=(0.0,) * 6, place_peg=BESIDE_THE_HOLE), DEADLINE_S)
        return session(bus, lease, "simulated")


def recorded(file: Path, **options: Any) -> dict[str, Any]:
    """The `hardware` section of a cell that plays a file, its time standing between commands."""
    return {"driver": "recorded", "simulated": {"speed": "max"}, "recorded": {"file": str(file), **options}}


def rewritten(
    source: Path, target: Path, leave_out: str = "", metadata: dict[str, dict[str, str]] | None = None
) -> Path:
    """The same file without a channel, or with other metadata."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader, writer = make_reader(stream), Writer(out)
        writer.start()
        for entry in reader.iter_metadata():
            content = (metadata or {}).get(entry.name, entry.metadata)
            if content:
                writer.add_metadata(entry.name, content)
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            if channel.topic.endswith(leave_out) and leave_out:
                continue
            if channel.id not in channels:
                assert schema is not None
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, kind, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()  # type: ignore[no-untyped-call]
    return target


def samples_of(batches: list[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Every stamp (m,) and every raw wrench (m, 6) of batches."""
    stamps = [batch.stamp_ns + batch.period_ns * index for batch in batches for index in range(len(batch.samples))]
    return np.array(stamps), np.array([sample for batch in batches for sample in batch.samples])
