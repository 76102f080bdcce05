"""The topics for viewers, made from the samples of one recording when the recorder has nothing else to do."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator

from crosspih_common.bus.codec import decoder_of, label_of
from crosspih_common.config import Workcell
from crosspih_common.foxglove import HEARD, OUT_OF_ORDER_NS, TRUTH_HEARD, FoxgloveTopics, ViewerTopic, arm_urdf
from crosspih_common.recording.viewers import URDF
from services.recorder.file import RecordingFile
from services.recorder.sample import Waiting

# the most that may wait to be shown: a minute of a cell that runs ten times as fast as real time
MAX_WAITING = 100_000
CHECK_EVERY = 16  # samples between two checks of the clock
_PATHS = frozenset(topic.path for topic in (*HEARD, *TRUTH_HEARD))


class ForViewers:
    """The topics for viewers of one recording. `offer` is quick and only keeps samples; `work` makes messages of them.
    One thread calls both.
    """

    def __init__(self, workcell: Workcell, rate_hz: float) -> None:
        self._urdf = arm_urdf(workcell).encode()
        self._topics = FoxgloveTopics(workcell, self._publish, rate_hz)
        self._waiting: deque[Waiting] = deque(maxlen=MAX_WAITING)
        self._made: list[tuple[ViewerTopic, int, bytes]] = []
        self._stamp_ns = self._wall_ns = 0
        self._counts: Counter[str] = Counter()

    def _publish(self, topic: ViewerTopic, stamp_ns: int, data: bytes) -> None:
        self._made.append((topic, stamp_ns, data))

    def begin(self, file: RecordingFile) -> None:
        """A file begins: write the arm, and the states that are known. Raises OSError."""
        file.attach(URDF, "application/xml", self._urdf)
        # write no frame before the states from the beginning, or a viewer would see time go back
        since_ns = max(self._stamp_ns - OUT_OF_ORDER_NS, 0)
        for topic, data in self._topics.known():
            file.show(topic, since_ns, self._wall_ns, data)
        file.flush_shown()

    def offer(self, samples: Iterable[Waiting]) -> None:
        """Keep a sample that a message can be made of; the oldest are dropped where too many wait."""
        kept = [sample for sample in samples if sample[1].path in _PATHS]
        over = len(self._waiting) + len(kept) - MAX_WAITING
        if over > 0:
            self._counts["not_shown"] += over
        self._waiting.extend(kept)

    def work(self, file: RecordingFile, within_s: float | None) -> None:
        """Write what waits, for at most this long; with None, all of it. Raises OSError."""
        until = None if within_s is None else time.monotonic() + within_s
        count = 0
        while self._waiting:
            if count % CHECK_EVERY == 0 and until is not None and time.monotonic() >= until:
                break
            count += 1
            self._show(self._waiting.popleft(), file)
        if count:
            file.flush_shown()

    def _show(self, sample: Waiting, file: RecordingFile) -> None:
        key, topic, payload, seq, stamp_ns, wall_ns = sample
        if not self._topics.wants(topic, stamp_ns):
            return
        try:
            self._topics.take(topic, decoder_of(topic.type)(payload, f"{label_of(topic.type)} {seq}", key))
        except Exception:
            # a failure in a viewers' topic must never end the recording: it is counted, and reported at the file's end
            self._counts["failed"] += 1
        self._stamp_ns, self._wall_ns = max(stamp_ns, self._stamp_ns), wall_ns
        for made, at_ns, data in self._drained():
            file.show(made, at_ns, wall_ns, data)
            self._counts["messages"] += 1

    def _drained(self) -> Iterator[tuple[ViewerTopic, int, bytes]]:
        made, self._made = self._made, []
        return iter(made)

    def metadata(self) -> dict[str, str]:
        """The number of messages made, and of samples of which none was made (`crosspih recording export foxglove`
        makes all of them anew).
        """
        return {name: str(self._counts[name]) for name in ("messages", "not_shown", "failed")}
