"""The recorder as a process beside a router process; what it wrote is read by the mcap library's own reader."""

from __future__ import annotations

import json
import signal
import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.keys import (
    CLOCK,
    CONTACT_WRENCH,
    EVENTS,
    FT_CALIBRATION,
    IMAGE_LEFT,
    JOINT_STATE,
    PHASE,
    RECORD_START,
    RECORD_STOP,
    STATUS,
    Topic,
)
from crosspih_common.messages import (
    AssemblyPhase,
    CellClock,
    ContactWrench,
    FtCalibration,
    Image,
    JointState,
    Phase,
    ServiceState,
    StartRecording,
    StopRecording,
)
from crosspih_common.recording import read_recording
from crosspih_common.recording.viewers import for_viewers
from tests.force_torque.made_calibrations import CALIBRATION

DEADLINE_S = 60.0  # a process reads its imports for half a minute beside twenty busy ones
CELL = "rec1"
BURST = 40  # samples between two waits: streams drop rather than wait, so a test must not flood them
MS = 1_000_000


def cell_file(tmp_path: Path) -> Path:
    path = tmp_path / "cell.yaml"
    path.write_text(f"cell:\n  name: {CELL}\nrecorder:\n  directory: {tmp_path / 'recordings'}\n")
    return path


@contextmanager
def bus_beside_recorder(endpoint: str, spawn: Callable[..., Any], tmp_path: Path) -> Iterator[tuple[Bus, Any]]:
    process = spawn("recorder", "--cell", str(cell_file(tmp_path)), "--endpoint", endpoint)
    with Bus(open_zenoh(endpoint), CELL, "hardware") as bus:
        alive = threading.Event()
        for name in ("force_torque", "planning"):  # in whose names it publishes too
            bus.also_close(bus.authors.claim(name))
        bus.watch_alive(lambda service, is_alive: alive.set() if service == "recorder" and is_alive else None)
        assert alive.wait(DEADLINE_S), "".join(process.output)
        yield bus, process


class Source:
    """Publishes numbered samples and waits, burst by burst, until they came back over the router."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.sent: Counter[str] = Counter()
        self.now_ns = 0
        self._clock = bus.latest(CLOCK)

    def publish(self, topic: Topic[Any], value: Any) -> None:
        self.now_ns += MS
        sent = value(self.now_ns)
        self.bus.publisher(topic).publish(sent)
        self.sent[topic.key(CELL)] += 1
        if sum(self.sent.values()) % BURST == 0:
            self.tick()

    def tick(self) -> None:
        """The cell's clock goes out and comes back: everything before it has passed the router."""
        self.now_ns += MS
        seq, _ = self.bus.publisher(CLOCK).publish(CellClock(stamp_ns=self.now_ns, boot_id="test", realtime=False))
        self.sent[CLOCK.key(CELL)] += 1
        assert self._clock.wait_for(lambda seen: seen.seq >= seq, DEADLINE_S) is not None
        self.bus.clock.observe(self.now_ns)


def joints(stamp_ns: int) -> JointState:
    return JointState(stamp_ns=stamp_ns, joints_rad=(0.1,) * 6, speeds_rad_s=(0.0,) * 6)


def wrench(stamp_ns: int) -> ContactWrench:
    return ContactWrench(
        stamp_ns=stamp_ns,
        wrench=(1.0, 2.0, -3.0, 0.1, 0.2, 0.3),
        in_contact=True,
        free_residual_n=0.05,
        drift_suspected=False,
    )


def phase(stamp_ns: int) -> AssemblyPhase:
    return AssemblyPhase(stamp_ns=stamp_ns, assembly_id="a", phase=Phase.PUSHING, text="pushes", figures={"n": 1.0})


def calibration(stamp_ns: int) -> FtCalibration:
    return CALIBRATION.model_copy(update={"stamp_ns": stamp_ns})


PIXELS = np.arange(640 * 480, dtype=np.uint32).reshape(480, 640).astype(np.uint8)


def picture(stamp_ns: int) -> Image:
    return Image("camera_left", PIXELS, stamp_ns)


def test_an_independent_reader_finds_every_sample(endpoint: str, spawn: Callable[..., Any], tmp_path: Path) -> None:
    with bus_beside_recorder(endpoint, spawn, tmp_path) as (bus, process):
        source = Source(bus)
        source.publish(FT_CALIBRATION, calibration)  # a state, from before the file began
        source.tick()
        started = bus.call(RECORD_START, StartRecording(name="trial 7/../x"), DEADLINE_S)
        assert started.recording
        source.sent.clear()
        started_ns = source.now_ns
        for index in range(1500):
            source.publish(JOINT_STATE, joints)
            source.publish(CONTACT_WRENCH, wrench)
            if index % 50 == 0:
                source.publish(PHASE, phase)
            if index % 500 == 0:
                source.publish(IMAGE_LEFT, picture)
        stopped = bus.call(RECORD_STOP, StopRecording(), DEADLINE_S)
        assert process.terminate() == 0
    assert not stopped.recording
    assert stopped.dropped == {}
    path = Path(stopped.path)
    assert path == Path(started.path) == (tmp_path / "recordings" / "trial_7_.._x-0001.mcap").resolve()

    counts: Counter[str] = Counter()
    sequences: dict[str, list[int]] = {}
    shown: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    factory = DecoderFactory()
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        channels = {channel.topic: channel for channel in summary.channels.values()}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if for_viewers(channel.topic):
                decoder = factory.decoder_for(channel.message_encoding, schema)
                assert decoder is not None
                shown[channel.topic].append((message.log_time, decoder(message.data)))
                continue
            if message.log_time > started_ns:  # the last tick from before the start may still be in it
                counts[channel.topic] += 1
            sequences.setdefault(channel.topic, []).append(message.sequence)
            if channel.topic == IMAGE_LEFT.key(CELL):
                assert schema is not None and schema.name == "foxglove.RawImage" and schema.encoding == "protobuf"
                image = RawImage.FromString(message.data)
                assert np.array_equal(np.frombuffer(image.data, np.uint8).reshape(480, 640), PIXELS)
                assert image.timestamp.ToNanoseconds() == message.log_time
            else:
                content = json.loads(message.data)
                assert (content["stamp_ns"], content["seq"]) == (message.log_time, message.sequence)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    for key, sent in source.sent.items():
        assert counts[key] == sent, key
    for key, numbers in sequences.items():
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), key
    assert len(sequences[FT_CALIBRATION.key(CELL)]) == 1
    assert counts[RECORD_STOP.request_echo.key(CELL)] == 1  # the recorder hears itself
    assert sum(map(len, sequences.values())) == stopped.messages
    assert summary.statistics.message_count == stopped.messages + sum(map(len, shown.values()))
    assert len(channels) - len(shown) == stopped.channels
    assert stopped.bytes_written == path.stat().st_size
    assert metadata["drops"]["overflow_total"] == metadata["drops"]["gaps_total"] == "0"
    assert metadata["cell"]["yaml"] == (tmp_path / "cell.yaml").read_text()
    assert metadata["cell"]["path"] == str(tmp_path / "cell.yaml")
    assert metadata["versions"]["mcap"]

    ours = read_recording(path)
    assert ours.finished and ours.cell == CELL and ours.seq_gaps() == {}
    assert [message.seq for message in ours.messages(JOINT_STATE)] == sequences[JOINT_STATE.key(CELL)]
    assert ours.problems == []
    assert dict(ours.shown) == {topic: len(told) for topic, told in shown.items()}
    assert metadata["foxglove"]["not_shown"] == metadata["foxglove"]["failed"] == "0"
    # what viewers are shown: every contact wrench, frames at 50 Hz at the most, each under the cell's time
    told = shown["/foxglove/wrench/contact"]
    assert len(told) == counts[CONTACT_WRENCH.key(CELL)]
    assert {type(message).DESCRIPTOR.full_name for _, message in told} == {"crosspih.WrenchSample"}
    frames = [at_ns for at_ns, _ in shown["/foxglove/transforms"]]
    assert len(frames) > 10 and min(after - before for before, after in pairwise(frames)) >= 0
    for at_ns, message in (row for rows in shown.values() for row in rows if hasattr(row[1], "timestamp")):
        assert message.timestamp.ToNanoseconds() in (at_ns, 0)


def test_a_kill_loses_no_more_than_the_last_flush_and_the_next_recorder_goes_on(
    endpoint: str, spawn: Callable[..., Any], tmp_path: Path
) -> None:
    with bus_beside_recorder(endpoint, spawn, tmp_path) as (bus, process):
        source = Source(bus)
        source.tick()  # which run of the cell this is
        started = bus.call(RECORD_START, StartRecording(name="torn"), DEADLINE_S)
        path = Path(started.path)
        for _ in range(400):
            source.publish(JOINT_STATE, joints)
        source.tick()
        flushed_ns = source.now_ns
        # a flush has passed once the clock's sample is on the disk: from here on it must survive
        poll = threading.Event()
        for _ in range(200):
            clock = read_recording(path, only=[CLOCK]).last(CLOCK)
            if clock is not None and clock.stamp_ns == flushed_ns:
                break
            poll.wait(0.1)
        else:
            raise AssertionError("nothing was flushed")
        for _ in range(200):
            source.publish(JOINT_STATE, joints)
        process.kill()
        assert process.process.returncode == -signal.SIGKILL
        recording = read_recording(path)
        assert not recording.finished and recording.tear
        assert "drops" not in recording.metadata and recording.metadata["cell"]["name"] == CELL
        numbers = [message.seq for message in recording.messages(JOINT_STATE)]
        assert 400 <= len(numbers) <= 600
        assert numbers == list(range(len(numbers)))
        clock = recording.last(CLOCK)
        assert clock is not None and clock.stamp_ns >= flushed_ns

        events, statuses = bus.latest(EVENTS, 8), bus.latest(STATUS, 8)
        process = spawn("recorder", "--cell", str(cell_file(tmp_path)), "--endpoint", endpoint)
        resumed = events.wait_for(lambda event: event.code == "recording_resumed", DEADLINE_S)
        assert resumed is not None and "torn-0001.part2.mcap" in resumed.text, "".join(process.output)
        for _ in range(100):
            source.publish(JOINT_STATE, joints)
        source.tick()
        pid = process.process.pid
        ready = statuses.wait_for(lambda status: (status.pid, status.state) == (pid, ServiceState.READY), DEADLINE_S)
        assert ready is not None, "".join(process.output)
        stopped = bus.call(RECORD_STOP, StopRecording(), DEADLINE_S)
        assert process.terminate() == 0
    part = path.with_name("torn-0001.part2.mcap")
    assert stopped.path == str(path) and stopped.parts == (str(path), str(part))
    assert any("the recorder was gone for" in warning for warning in stopped.warnings)
    both = read_recording(path)
    assert [each.finished for each in both.parts] == [False, True]
    seen = [message.seq for message in both.messages(JOINT_STATE)]
    assert seen == [*numbers, *range(600, 700)]
    assert both.seq_gaps().get(JOINT_STATE.key(CELL), 0) == 600 - len(numbers)


def test_sigterm_finishes_the_file(endpoint: str, spawn: Callable[..., Any], tmp_path: Path) -> None:
    with bus_beside_recorder(endpoint, spawn, tmp_path) as (bus, process):
        source = Source(bus)
        started = bus.call(RECORD_START, StartRecording(), DEADLINE_S)
        for _ in range(100):
            source.publish(PHASE, phase)
        source.tick()
        bus.call(RECORD_START, StartRecording(), DEADLINE_S)  # finishes the first, begins the second
        assert process.terminate() == 0
    first = read_recording(started.path)
    second = read_recording(Path(started.path).with_name("recording-0002.mcap"))
    assert first.finished and len(first.messages(PHASE)) == 100
    assert second.finished and second.metadata["drops"]["gaps_total"] == "0"
