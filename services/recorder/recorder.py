"""The recorder's core: takes samples from any thread and writes them on one; begins, continues and finishes files."""

from __future__ import annotations

import errno
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import Any

from crosspih_common.errors import CommandRefused, ContractError
from crosspih_common.keys import CLOCK, STATUS, Kind, Topic
from crosspih_common.messages import RecordingStatus
from services.recorder.broken_off import ASKED, SHUT_DOWN, BrokenOff
from services.recorder.config import RecorderConfig
from services.recorder.file import RecordingFile
from services.recorder.for_viewers import ForViewers
from services.recorder.inbox import Inbox
from services.recorder.losses import warnings_of
from services.recorder.sample import LONGEST_STAMP, STAMP_FIRST, Sample, Waiting, stamp_of
from services.recorder.tally import Tally
from services.recorder.tape import DiskFull, Metadata, Tape, why_of

DRAIN_S = 5.0
# sent by wall time whatever the cell does: they do not show whether the cell has finished sending
ALWAYS_SPEAKING = (CLOCK.path, STATUS.path)
# how far one service's cell clock may be ahead of another's: a few ticks of the clock
CLOCK_SLACK_NS = 60_000_000
# how many samples are kept while it is not yet known whether a recording goes on
UNDECIDED_SAMPLES = 20_000

# how long to write viewers' messages each time that chunks are closed: samples come first, and viewers' messages have
# time until the recording ends
SHOW_S = 0.05

_key_of = itemgetter(Sample._fields.index("key"))
Tell = Callable[[str, str], None]
Look = Callable[[], BrokenOff | bool | None]


def _none() -> None:
    return None


class Recorder:
    """At most one recording at a time.

    `metadata()` gives the metadata at the beginning of every file. `tell(code, text)` is called once for each of these:
    the disk fails (`recording_failed`), a recording goes on in a new part (`recording_resumed`), and samples are
    missing that matter. `look()` gives the recording that a predecessor left: None where there is none, False while
    that is not yet known. `for_viewers()` gives the object that makes a recording's topics for viewers, or None for no
    such topics.
    """

    def __init__(
        self, config: RecorderConfig, metadata: Callable[[], Metadata], tell: Tell, look: Look = _none,
        for_viewers: Callable[[], ForViewers | None] = _none,
    ) -> None:  # fmt: skip
        self._config, self._metadata, self._tell = config, metadata, tell
        self._look: Look | None = look
        self._for_viewers = for_viewers
        self._inbox = Inbox(config.queue_samples, config.queue_bytes)
        self._tally = Tally()
        self._lock = threading.Lock()  # guards the tape and the states
        self._tape: Tape | None = None
        self._states: dict[str, Sample] = {}
        self._state_keys: set[str] = set()
        self._kinds: dict[str, Kind] = {}
        self._undecided: deque[Waiting] = deque(maxlen=UNDECIDED_SAMPLES)
        self._told: set[str] = set()
        self._last = RecordingStatus(recording=False)
        self._stop_stamp_ns: int | None = None
        self._spoke_at = 0.0
        self._thread = threading.Thread(target=self._run, name="recorder:writer", daemon=True)
        self._thread.start()

    @property
    def writes(self) -> bool:
        """Whether the writer's thread still runs."""
        return self._thread.is_alive()

    # ------------------------------------------------------------------------------------------------------ samples

    def taker(
        self, topic: Topic[Any], key: str, on_full: Callable[[], object], on_malformed: Callable[[str], object]
    ) -> Callable[[bytes, int], None]:
        """A callback that takes the samples of one key, (payload, number), on the bus's thread. `on_full` is called
        where there is no room, `on_malformed` with the reason why something is no sample of the topic.

        Everything that depends only on the key is computed here, once. The rest is done for each sample in one
        function, because a function call costs as much as the work itself.
        """
        kind, always = topic.kind, topic.path in ALWAYS_SPEAKING
        tally, account, offer = self._tally, self._tally.account(key, topic.rate_hz), self._inbox.offerer()
        monotonic, time_ns, begins = time.monotonic, time.time_ns, len(STAMP_FIRST)
        if kind is Kind.STATE:
            self._state_keys.add(key)
        self._kinds[key] = kind

        def take(payload: bytes, seq: int) -> None:
            now_s = monotonic()
            line = account.line
            if line is not None and line.expected == seq:  # as nearly all are
                account.heard += 1
                line.expected, line.heard_s = seq + 1, now_s
            else:
                account.count_sample(seq, now_s)
            ends = payload.find(b",", begins, LONGEST_STAMP)
            if ends > 0 and (digits := payload[begins:ends]).isdigit() and payload.startswith(STAMP_FIRST):
                stamp_ns = int(digits)
            else:
                try:
                    stamp_ns = stamp_of(topic, payload)
                except ContractError as error:
                    tally.count("malformed", key)
                    on_malformed(f"{key}: {error}")
                    return
            stop_ns = self._stop_stamp_ns
            if stop_ns is not None and not always and (kind is not Kind.STREAM or stamp_ns <= stop_ns + CLOCK_SLACK_NS):
                self._spoke_at = now_s
            if not offer((key, topic, payload, seq, stamp_ns, time_ns()), len(payload)):
                tally.count("overflow", key)
                on_full()

        return take

    def refused(self, key: str) -> None:
        """Count a sample that was refused before this point: of another type than its key's."""
        self._tally.count("refused", key)

    def _run(self) -> None:
        flush_at = time.monotonic() + self._config.flush_s
        while not self._inbox.closed:
            batch = self._inbox.take(max(flush_at - time.monotonic(), 0.0))
            said: list[tuple[str, str]] = []
            with self._lock:
                self._write(batch, said)
                if time.monotonic() >= flush_at:
                    self._periodically(said)
                    flush_at = time.monotonic() + self._config.flush_s
            self._inbox.settle(len(batch))
            for code, text in said:
                self._tell(code, text)

    def _write(self, batch: list[Waiting], said: list[tuple[str, str]]) -> None:
        self._decide(said)
        if not self._state_keys.isdisjoint(map(_key_of, batch)):
            self._states.update((sample[0], Sample(*sample)) for sample in batch if sample[0] in self._state_keys)
        tape, rest = self._tape, iter(batch)
        if tape is None:
            if self._look is not None:
                self._undecided.extend(rest)
            return
        if tape.file is not None:
            if tape.viewers is not None:
                tape.viewers.offer(batch)
            self._attempt(RecordingFile.write_all, said, rest)
        for sample in rest:  # the samples after one that could not be written
            self._tally.count("unwritten", _key_of(sample))

    def _periodically(self, said: list[tuple[str, str]]) -> None:
        tape = self._tape
        if tape is None:
            return
        self._attempt(RecordingFile.flush, said)
        self._attempt(lambda _: tape.show(SHOW_S), said)
        if tape.file is None and tape.may_try_again():
            try:
                path = tape.go_on(self._begin_with())
            except OSError:
                return  # it was reported when it failed
            self._tell_missing(said, "recording_resumed", f"the disk can be written again: goes on in {path}")
        for code, text in warnings_of(self._tally.counts(), self._kinds).items():
            if code not in self._told:
                self._told.add(code)
                said.append((code, text))

    def _tell_missing(self, said: list[tuple[str, str]], code: str, text: str) -> None:
        if self._tape is not None:
            self._tape.warnings.append(text)
        said.append((code, text))

    def _attempt(self, work: Callable[..., None], said: list[tuple[str, str]], *arguments: Iterator[Waiting]) -> None:
        """Work on the file, if there is one. A file that cannot be written is given up and reported once."""
        tape = self._tape
        if tape is None or tape.file is None:
            return
        try:
            work(tape.file, *arguments)
        except Exception as error:
            # whatever the error was, the writer's thread must outlive it: the next file may work
            path = tape.file.path
            for key, count in tape.let_go(error).items():
                self._tally.count("unwritten", key, count)
            self._tell_missing(
                said,
                "recording_failed",
                f"{path}: {why_of(error)}; nothing is recorded until there is space; free some or set "
                "recorder.directory",
            )

    def _begin_with(self) -> list[Sample]:
        return sorted(self._states.values(), key=lambda sample: sample.wall_ns)

    # --------------------------------------------------------------------------------------- a predecessor's recording

    def _decide(self, said: list[tuple[str, str]]) -> None:
        """Decide whether to go on with a predecessor's recording, as soon as that can be known."""
        if self._look is None:
            return
        found = self._look()
        if found is False:
            return
        self._look = None
        waiting, self._undecided = list(self._undecided), deque(maxlen=1)
        if not isinstance(found, BrokenOff):
            return
        tape = Tape(self._config, self._metadata, found.name, found.first, found.last_part + 1, self._for_viewers())
        self._tally.begin()
        self._told.clear()
        try:
            path = tape.go_on([])
        except OSError as error:
            said.append(("recording_failed", f"{found.first} cannot go on: {why_of(error)}"))
            return
        self._tape = tape
        if tape.viewers is not None:
            tape.viewers.offer(waiting)
        for sample in waiting:
            self._attempt(RecordingFile.write_all, said, iter([sample]))
        text = f"the recorder was gone for {found.ago_s:.1f} s, of which nothing is recorded: goes on in {path}"
        self._tell_missing(said, "recording_resumed", text)

    def _wait_decided(self, deadline_s: float) -> None:
        """Wait until it is known whether a recording goes on; at the deadline it does not."""
        until = time.monotonic() + deadline_s
        while self._look is not None and time.monotonic() < until:
            time.sleep(0.02)

    # ----------------------------------------------------------------------------------------------------- commands

    def start(self, name: str, stamp_ns: int) -> RecordingStatus:
        """Begin a recording; a running one is first finished as by `stop`. Where no file can be made: `trouble` in the
        reply, or CommandRefused with `recorder.required`.
        """
        self._catch_up(stamp_ns)
        with self._lock:
            self._look = None
            self._undecided.clear()
            self._finish(ASKED)
            tape = Tape(self._config, self._metadata, name, viewers=self._for_viewers())
            try:
                tape.begin(self._begin_with())
            except OSError as error:
                mend = "free some space" if isinstance(error, DiskFull) or error.errno == errno.ENOSPC else (
                    "set recorder.directory in the cell's file to a directory that can be written"
                )  # fmt: skip
                trouble = f"cannot make a file in {self._config.directory}: {why_of(error)}; {mend}"
                if self._config.required:
                    raise CommandRefused("unwritable", trouble) from None
                self._last = RecordingStatus(recording=False, trouble=trouble)
                return self._last
            self._tally.begin()
            self._told.clear()
            self._tape = tape
            return self._status()

    def stop(self, stamp_ns: int) -> RecordingStatus:
        """Finish the recording once all that was sent before `stamp_ns` (cell clock) is in it."""
        self._wait_decided(DRAIN_S)
        self._catch_up(stamp_ns)
        with self._lock:
            self._finish(ASKED)
            return self._last

    def _catch_up(self, stamp_ns: int) -> None:
        """Samples and commands arrive by different ways, so a command may arrive first: give the samples time to
        arrive.
        """
        with self._lock:
            recording = self._tape is not None
        if recording:
            begun = time.monotonic()
            limit = begun + self._config.quiet_limit_s
            self._stop_stamp_ns = stamp_ns
            while (now := time.monotonic()) < (until := min(max(self._spoke_at, begun) + self._config.quiet_s, limit)):
                time.sleep(until - now)
            self._stop_stamp_ns = None
        self._inbox.drain(DRAIN_S)

    def _finish(self, why: str) -> None:
        tape = self._tape
        if tape is None:
            return
        if tape.file is not None:
            try:
                tape.finish({"drops": self._tally.metadata(), "end": {"why": why}})
            except Exception as error:
                for key, count in tape.let_go(error).items():
                    self._tally.count("unwritten", key, count)
                tape.warnings.append(f"its end could not be written: {why_of(error)}")
        self._last = self._status_of(tape, recording=False)
        self._tape = None

    def status(self) -> RecordingStatus:
        """The current recording, or the last one."""
        with self._lock:
            return self._status()

    def _status(self) -> RecordingStatus:
        return self._last if self._tape is None else self._status_of(self._tape, recording=self._tape.file is not None)

    def _status_of(self, tape: Tape, recording: bool) -> RecordingStatus:
        warnings = warnings_of(self._tally.counts(), self._kinds)
        return RecordingStatus(
            recording=recording,
            path=str(tape.parts[0]) if tape.parts else "",
            messages=tape.messages,
            channels=tape.channels,
            bytes_written=tape.bytes_written,
            dropped=self._tally.lost(),
            parts=tuple(map(str, tape.parts)),
            trouble=tape.trouble,
            warnings=(*tape.warnings, *warnings.values()),
        )

    def close(self) -> None:
        """End the writer; a running recording is closed such that a successor may go on with it."""
        self._inbox.drain(DRAIN_S)
        with self._lock:
            self._finish(SHUT_DOWN)
        self._inbox.close()
        self._thread.join(2.0)


__all__ = ["Recorder"]
