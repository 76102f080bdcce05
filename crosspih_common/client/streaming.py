"""The samples of one topic, one after the other, for a loop."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Generic, TypeVar

from crosspih_common.errors import CommandTimeout
from crosspih_common.keys import Payload

PayloadT = TypeVar("PayloadT", bound=Payload)
DEPTH = 1024  # samples that wait for a slow reader: ten seconds of a wrench at 100 Hz
NOTICED_S = 0.5  # period at which a waiting reader checks whether the cell was closed

Handler = Callable[[PayloadT], None]
Listen = Callable[[Handler[PayloadT]], AbstractContextManager[None]]


class Stream(Generic[PayloadT]):
    """The samples of a topic from the start of the block to its end, in the order of arrival.

    At most `depth` samples wait: if the reader is slower than the topic, the oldest are dropped and `dropped` counts
    them. With `timeout_s` the loop raises CommandTimeout if nothing comes for that long (wall time). A cell at
    `--speed max` publishes nothing between commands, because its time stands still.
    """

    def __init__(
        self, path: str, listen: Listen[PayloadT], depth: int = DEPTH, timeout_s: float | None = None,
        is_over: Callable[[], bool] = lambda: False,
    ) -> None:  # fmt: skip
        self.path, self.depth, self.timeout_s = path, depth, timeout_s
        self.dropped = 0
        self._listen, self._is_over = listen, is_over
        self._waiting: deque[PayloadT] = deque()
        self._changed = threading.Condition()
        self._open: AbstractContextManager[None] | None = None

    def __enter__(self) -> Stream[PayloadT]:
        self._open = self._listen(self._push)
        self._open.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop listening; a loop over the stream ends. Safe to call twice."""
        opened, self._open = self._open, None
        if opened is not None:
            opened.__exit__(None, None, None)
        with self._changed:
            self._changed.notify_all()

    def _push(self, sample: PayloadT) -> None:
        with self._changed:
            if len(self._waiting) >= self.depth:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(sample)
            self._changed.notify_all()

    def __iter__(self) -> Iterator[PayloadT]:
        while self._await_sample():
            with self._changed:
                sample = self._waiting.popleft()
            yield sample

    def take_all(self) -> list[PayloadT]:
        """All samples that wait, oldest first; waits for the first. Empty once the stream or its cell was closed.

        Raises CommandTimeout where nothing came for `timeout_s`.
        """
        if not self._await_sample():
            return []
        with self._changed:
            batch = list(self._waiting)
            self._waiting.clear()
        return batch

    def _await_sample(self) -> bool:
        """Whether a sample waits, now or when one comes; False once the stream or its cell was closed."""
        until = None if self.timeout_s is None else time.monotonic() + self.timeout_s
        with self._changed:
            while not self._waiting:
                if self._open is None or self._is_over():
                    return False
                left_s = NOTICED_S if until is None else min(NOTICED_S, until - time.monotonic())
                if left_s <= 0.0:
                    raise CommandTimeout(
                        f"{self.path}: nothing was heard for {self.timeout_s:g} s; is its service up (`crosspih ps`), "
                        "and does the cell do something? At --speed max its time stands still between commands"
                    )
                self._changed.wait(left_s)
            return True
