"""The worker threads of the bus: one pump for each subscription to all samples, one lane for each queue of commands."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from crosspih_common.bus.duty import JOB_S, SAMPLE_S, Duty

ValueT = TypeVar("ValueT")
_END = object()


class Pump(Generic[ValueT]):
    """Hands values to a handler one by one on its own thread; refuses values when its queue is full.

    Threads that offer at the same time may each find the last place free.
    """

    def __init__(
        self, handler: Callable[[ValueT], object], capacity: int, name: str, on_error: Callable[[Exception], None]
    ) -> None:
        self._queue: queue.SimpleQueue[object] = queue.SimpleQueue()
        self._capacity = capacity
        self._handler, self._on_error = handler, on_error
        self._closed = threading.Event()
        self.duty = Duty(name)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.duty.of(self._thread)
        self._thread.start()

    def offer(self, value: ValueT) -> bool:
        """Enqueue; False when full."""
        if self._queue.qsize() >= self._capacity:
            return False
        self._queue.put(value)
        return True

    def _run(self) -> None:
        self.duty.here()
        while not self._closed.is_set():
            value = self._queue.get()
            if value is _END:
                return
            self.duty.begin(SAMPLE_S)
            try:
                self._handler(value)  # type: ignore[arg-type]
            except Exception as error:
                self._on_error(error)
            finally:
                self.duty.end()

    def close(self) -> None:
        """End the thread; values that still wait are dropped."""
        self.duty.closed = True
        self._closed.set()
        self._queue.put(_END)
        if threading.current_thread() is not self._thread:
            self._thread.join(2.0)


Job = Callable[[], Callable[[], None]]


class Lane:
    """Carries out jobs one after the other on its own thread.

    A job returns a function that sends its answer. It is called once the lane counts as idle again, so that the
    receiver may send the next job at once.
    """

    def __init__(self, name: str, longest_s: float = JOB_S) -> None:
        self._queue: queue.Queue[Job | None] = queue.Queue()
        self._lock = threading.Lock()
        self._waiting = 0
        self.longest_s = longest_s  # limit for one job
        self.duty = Duty(name)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.duty.of(self._thread)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a job is under way or waits."""
        with self._lock:
            return self._waiting > 0

    def offer(self, job: Job, only_when_idle: bool = False) -> bool:
        """Enqueue a job; False when `only_when_idle` and it is not."""
        with self._lock:
            if only_when_idle and self._waiting:
                return False
            self._waiting += 1
        self._queue.put(job)
        return True

    def _run(self) -> None:
        self.duty.here()
        while True:
            job = self._queue.get()
            if job is None:
                return
            self.duty.begin(self.longest_s)
            try:
                say = job()
            finally:
                self.duty.end()
                with self._lock:
                    self._waiting -= 1
            say()

    def close(self) -> None:
        """End the thread after the job under way; does not wait for a long one."""
        self.duty.closed = True
        self._queue.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(0.5)
