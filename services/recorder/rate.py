"""`python -m services.recorder.rate`: how fast samples get into a file, compared with the bare MCAP writer.

The samples are those of an arm: joint states, raw and contact wrenches, as often as a cell sends them. `ours` is the
whole way from the bus's callback: label, author, numbers, stamp, inbox, the writer's thread, and the file with its end.
`bare` is mcap's own `Writer.add_message` with the same chunks and compression, one call a sample. `shown` is `ours`
with the topics for viewers, all of which are made before the file ends. The three take turns. The result is one JSON
object on standard output, which `crosspih bench recorder` shows. With `--paced HZ` samples come at that rate instead,
topics for viewers are made of them, and the lost samples are counted.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from crosspih_common.bus import Bus
from crosspih_common.bus.codec import encode, label_with_seq
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.bus.transport import AuthoredHandler
from crosspih_common.config import Workcell
from crosspih_common.foxglove.own_messages import channel_schema
from crosspih_common.keys import CONTACT_WRENCH, JOINT_STATE, WRENCH_RAW, Payload, Topic
from crosspih_common.messages import ContactWrench, JointState, RawWrenchBatch
from services.recorder.config import RecorderConfig
from services.recorder.for_viewers import ForViewers
from services.recorder.recorder import Recorder
from services.recorder.shell import tap_all

CELL = "bench-recorder"
ROUNDS = 5
STEP_NS = 4_000_000
JOINT_STATES_A_BATCH = 3  # close to a cell: 250 joint states, 100 raw batches and 100 contact wrenches a second

Heard = tuple[AuthoredHandler, str, bytes, str, str]  # the bus's callback and its arguments
Sent = tuple[Topic[Any], str, bytes, str, int]  # topic, key, payload, label, stamp


def samples(count: int) -> list[Sent]:
    """The given number of samples, as a cell sends them."""
    made: list[Sent] = []

    def add(topic: Topic[Any], value: Payload, number: int) -> None:
        label = label_with_seq(topic.type, number)
        made.append((topic, topic.key(CELL, topic.publisher), encode(value), label, value.stamp_ns))

    step = 0
    while len(made) < count:
        stamp_ns, batch = step * STEP_NS, step // JOINT_STATES_A_BATCH
        wave = tuple(0.123456789 * (axis + 1) + 1e-7 * step for axis in range(6))
        add(JOINT_STATE, JointState(stamp_ns=stamp_ns, seq=step, joints_rad=wave, speeds_rad_s=wave), step)
        if step % JOINT_STATES_A_BATCH == 0:
            rows = tuple(tuple(value * row for value in wave) for row in range(1, 11))
            add(WRENCH_RAW, RawWrenchBatch(stamp_ns=stamp_ns, seq=batch, period_ns=1_000_000, samples=rows), batch)
            felt = ContactWrench(
                stamp_ns=stamp_ns, seq=batch, wrench=wave, in_contact=False, free_residual_n=0.1, drift_suspected=False
            )
            add(CONTACT_WRENCH, felt, batch)
        step += 1
    return made[:count]


def bare(sent: Sequence[Sent], folder: Path, config: RecorderConfig) -> None:
    """The MCAP library alone."""
    with (folder / "bare.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=config.chunk_bytes, compression=CompressionType[config.compression.name])
        writer.start()
        channels: dict[str, int] = {}
        for topic, key, _, _, _ in sent[:10]:
            if key not in channels:
                name, encoding, message_encoding, data = channel_schema(topic.type)
                channels[key] = writer.register_channel(
                    key, message_encoding, writer.register_schema(name, encoding, data)
                )
        for _, key, payload, _, stamp_ns in sent:
            writer.add_message(channels[key], stamp_ns, payload, stamp_ns)
        writer.finish()  # type: ignore[no-untyped-call]


class Ours:
    """The recorder on a bus in memory, with its publishers."""

    def __init__(self, folder: Path, shows: bool = False) -> None:
        self.config = RecorderConfig(directory=folder, quiet_s=0.0, queue_samples=1_000_000, min_free_bytes=0)
        self._hub = MemoryHub()
        self._bus = Bus(self._hub.transport(), CELL, "recorder")
        self._recorder = Recorder(
            self.config, lambda: {}, lambda code, text: None, for_viewers=lambda: _for_viewers(shows)
        )
        tap_all(self._bus, self._recorder)
        self._authors: dict[str, str] = {}
        self._buses = []
        for name in {topic.publisher for topic in (JOINT_STATE, WRENCH_RAW, CONTACT_WRENCH)}:
            transport = self._hub.transport()
            self._authors[name] = transport.author
            self._buses.append(Bus(transport, CELL, name))

    def heard(self, sent: Sequence[Sent]) -> list[Heard]:
        """The callback that the bus calls with each sample, and its argument: the recorder's is the only
        subscription.
        """
        found: list[Heard] = []
        for topic, key, payload, label, _ in sent:
            (callback,) = self._hub.handlers_of(key)
            found.append((callback, key, payload, label, self._authors[topic.publisher]))
        return found

    def write(self, heard: Sequence[Heard], pace: Callable[[int], None] | None = None) -> int:
        """Write one recording of all samples; returns how many of them are missing from it. Raises RuntimeError where
        none can begin.
        """
        status = self._recorder.start("ours", 0)
        if not status.recording:
            raise RuntimeError(status.trouble)
        if pace is None:
            for callback, key, payload, label, author in heard:
                callback(key, payload, label, author)
        else:
            for index, (callback, key, payload, label, author) in enumerate(heard):
                pace(index)
                callback(key, payload, label, author)
        return len(heard) - self._recorder.stop(0).messages

    def close(self) -> None:
        """End the writer's thread and the buses."""
        self._recorder.close()
        for bus in (*self._buses, self._bus):
            bus.close()


def _for_viewers(shows: bool) -> ForViewers | None:
    return ForViewers(Workcell(), RecorderConfig().foxglove_hz) if shows else None


def _rates(work: Callable[[], object], count: int) -> tuple[float, float]:
    began_s, cpu_s = time.perf_counter(), time.process_time()
    work()
    return count / (time.perf_counter() - began_s), count / (time.process_time() - cpu_s)


def measure(count: int, rounds: int = ROUNDS) -> dict[str, list[float]]:
    """Samples a second of each, round by round, by wall time and by CPU time."""
    sent = samples(count)
    rates: dict[str, list[float]] = {f"{name}{of}": [] for name in ("bare", "ours", "shown") for of in ("", "_cpu")}
    folder = Path(tempfile.mkdtemp(prefix="crosspih-recorder-"))
    ours, shown = Ours(folder), Ours(folder, shows=True)
    heard, heard_shown = ours.heard(sent), shown.heard(sent)
    work: dict[str, Callable[[], object]] = {
        "bare": lambda: bare(sent, folder, ours.config),
        "ours": lambda: ours.write(heard),
        "shown": lambda: shown.write(heard_shown),
    }
    try:
        for index in range(rounds):
            for name in list(work)[:: -1 if index % 2 else 1]:
                wall, cpu = _rates(work[name], count)
                rates[name].append(wall)
                rates[f"{name}_cpu"].append(cpu)
    finally:
        ours.close()
        shown.close()
        shutil.rmtree(folder, ignore_errors=True)
    return rates


def paced(count: int, rate_hz: float) -> dict[str, float]:
    """Send this many samples at a rate and make topics for viewers of them: how many were lost, and how
    long it took.
    """
    sent = samples(count)
    folder = Path(tempfile.mkdtemp(prefix="crosspih-recorder-"))
    ours = Ours(folder, shows=True)
    began_s = time.monotonic()

    def pace(index: int) -> None:
        ahead_s = index / rate_hz - (time.monotonic() - began_s)
        if ahead_s > 0.001:
            time.sleep(ahead_s)

    try:
        lost = ours.write(ours.heard(sent), pace)
        return {"lost": lost, "seconds": time.monotonic() - began_s, "samples": count}
    finally:
        ours.close()
        shutil.rmtree(folder, ignore_errors=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=20_000, help="samples a round, or in all")
    parser.add_argument("--paced", type=float, help="samples a second")
    given = parser.parse_args()
    print(json.dumps(measure(given.steps) if given.paced is None else paced(given.steps, given.paced)))


if __name__ == "__main__":
    main()
