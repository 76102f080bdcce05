"""The publisher of one topic."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

from crosspih_common.bus.clock import BusClock
from crosspih_common.bus.codec import label_of, stamper_of
from crosspih_common.bus.traffic import KeyCounters
from crosspih_common.bus.transport import Sender
from crosspih_common.keys import Payload, Topic

PayloadT = TypeVar("PayloadT", bound=Payload)


class Publisher(Generic[PayloadT]):
    """Sends on one key: numbers each sample and stamps it with the cell's clock where it has no stamp yet."""

    def __init__(self, topic: Topic[PayloadT], key: str, sender: Sender, clock: BusClock, counts: KeyCounters) -> None:
        self.key, self._put, self._clock, self._counts = key, sender.put, clock, counts
        self._label = label_of(topic.type)
        self._encode = stamper_of(topic.type)
        self._lock = threading.Lock()
        self._seq = 0

    def publish(self, value: PayloadT) -> tuple[int, bytes]:
        """Send a value, which is not changed. Returns the number and the bytes that were sent."""
        with self._lock:
            seq = self._seq
            stamp_ns = value.stamp_ns
            payload = self._encode(value, stamp_ns if stamp_ns >= 0 else self._clock.now_ns(), seq)
            self._put(payload, f"{self._label} {seq}")
            self._seq = seq + 1
            self._counts.out += 1
        return seq, payload
