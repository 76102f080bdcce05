"""The recorder's core: takes samples from any thread, writes them on one, begins and finishes files."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from crosspih_common.errors import CommandRefused, ContractError
from crosspih_common.keys import CLOCK, STATUS, Kind, Topic
from crosspih_common.messages import RecordingStatus
from services.recorder.config import RecorderConfig
from services.recorder.file import RecordingFile, create_file
from services.recorder.inbox import Inbox
from services.recorder.sample import Sample, stamp_of
from services.recorder.tally import Tally

DRAIN_S = 5.0
# sent by wall time whatever the cell does: they say nothing about whether the cell has finished speaking
ALWAYS_SPEAKING = (CLOCK.path, STATUS.path)
# how far one service's cell clock may be ahead of another's: a few ticks of the clock
CLOCK_SLACK_NS = 60_000_000


class Recorder:
    """At most one file at a time. `metadata()` gives what every file begins with; `on_failure` hears of a bad disk."""

    def __init__(
        self,
        config: RecorderConfig,
        metadata: Callable[[], Mapping[str, Mapping[str, str]]],
        on_failure: Callable[[str], None],
    ) -> None:
        self._config, self._metadata, self._on_failure = config, metadata, on_failure
        self._inbox = Inbox(config.queue_samples, config.queue_bytes)
        self._tally = Tally()
        self._lock = threading.Lock()  # guards the file and the states
        self._file: RecordingFile | None = None
        self._states: dict[str, Sample] = {}
        self._last = RecordingStatus(recording=False)
        self._stop_stamp_ns: int | None = None
        self._spoke_at = 0.0
        self._thread = threading.Thread(target=self._run, name="recorder:writer", daemon=True)
        self._thread.start()

    # ------------------------------------------------------------------------------------------------------ samples

    def take(self, topic: Topic[Any], key: str, payload: bytes, seq: int) -> bool:
        """A sample from the bus, on the bus's thread; False when there is no room. Raises ContractError."""
        self._tally.arrived(key, seq)
        try:
            stamp_ns = stamp_of(topic, payload)
        except ContractError:
            self._tally.count("malformed", key)
            raise
        stop_ns = self._stop_stamp_ns
        if topic.path not in ALWAYS_SPEAKING and (
            topic.kind is not Kind.STREAM or stop_ns is None or stamp_ns <= stop_ns + CLOCK_SLACK_NS
        ):
            self._spoke_at = time.monotonic()
        if self._inbox.offer(Sample(key, topic, payload, seq, stamp_ns, time.time_ns())):
            return True
        self._tally.count("overflow", key)
        return False

    def _run(self) -> None:
        flush_at = time.monotonic() + self._config.flush_s
        while not self._inbox.closed:
            batch = self._inbox.take(max(flush_at - time.monotonic(), 0.0))
            with self._lock:
                for sample in batch:
                    if sample.topic.kind is Kind.STATE:
                        self._states[sample.key] = sample
                    self._attempt(RecordingFile.write, sample)
                if time.monotonic() >= flush_at:
                    self._attempt(RecordingFile.flush)
                    flush_at = time.monotonic() + self._config.flush_s
            self._inbox.settle(len(batch))

    def _attempt(self, work: Callable[..., None], *arguments: Sample) -> None:
        """Work on the file, if there is one; a file that cannot be written is let go of and reported once."""
        file = self._file
        if file is None:
            return
        try:
            work(file, *arguments)
        except Exception as error:
            # whatever it was, the writer's thread must outlive it: the next file may do
            self._let_go(file, error)

    def _let_go(self, file: RecordingFile, error: Exception) -> None:
        self._last = self._status_of(file, recording=False)
        self._file = None
        file.abandon()
        why = (error.strerror or str(error)) if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
        self._on_failure(f"{file.path}: {why}; free space or set recorder.directory, then record anew")

    # ----------------------------------------------------------------------------------------------------- commands

    def start(self, name: str, stamp_ns: int) -> RecordingStatus:
        """Begin a file, the running one finished as by `stop`. Raises CommandRefused when it cannot be made."""
        self._catch_up(stamp_ns)
        with self._lock:
            self._finish()
            try:
                path, stream = create_file(self._config.directory, name)
                try:
                    file = RecordingFile(path, stream, self._config, self._metadata())
                except OSError:
                    stream.close()
                    raise
            except OSError as error:
                raise CommandRefused(
                    "unwritable",
                    f"cannot make a file in {self._config.directory}: {error.strerror or error}; "
                    "set recorder.directory in the cell's file to a directory that can be written",
                ) from None
            self._tally.begin()
            self._file = file
            for state in sorted(self._states.values(), key=lambda sample: sample.wall_ns):
                self._attempt(RecordingFile.write, state)
            self._attempt(RecordingFile.flush)
            return self._status()

    def stop(self, stamp_ns: int) -> RecordingStatus:
        """Finish the file once all that was sent before `stamp_ns` (cell clock) is in it."""
        self._catch_up(stamp_ns)
        with self._lock:
            self._finish()
            return self._last

    def _catch_up(self, stamp_ns: int) -> None:
        """Samples and commands come by different ways, so a command may be first: give the samples time to arrive."""
        with self._lock:
            recording = self._file is not None
        if recording:
            begun = time.monotonic()
            limit = begun + self._config.quiet_limit_s
            self._stop_stamp_ns = stamp_ns
            while (now := time.monotonic()) < (until := min(max(self._spoke_at, begun) + self._config.quiet_s, limit)):
                time.sleep(until - now)
            self._stop_stamp_ns = None
        self._inbox.drain(DRAIN_S)

    def _finish(self) -> None:
        file = self._file
        if file is None:
            return
        try:
            size = file.finish({"drops": self._tally.metadata()})
        except OSError as error:
            self._let_go(file, error)
            return
        self._last = self._status_of(file, recording=False).model_copy(update={"bytes_written": size})
        self._file = None

    def status(self) -> RecordingStatus:
        """The file being written, or the last one."""
        with self._lock:
            return self._status()

    def _status(self) -> RecordingStatus:
        return self._last if self._file is None else self._status_of(self._file, recording=True)

    def _status_of(self, file: RecordingFile, recording: bool) -> RecordingStatus:
        return RecordingStatus(
            recording=recording,
            path=str(file.path),
            messages=file.messages,
            channels=file.channels,
            bytes_written=file.bytes_written(),
            dropped=self._tally.lost(),
        )

    def close(self) -> None:
        """Finish the file and end the writer."""
        self._inbox.drain(DRAIN_S)
        with self._lock:
            self._finish()
        self._inbox.close()
        self._thread.join(2.0)


__all__ = ["Recorder"]
