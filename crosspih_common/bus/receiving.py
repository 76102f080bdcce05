"""Checks of each incoming sample, on the transport's thread: is it of the key's type, and from its author?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from pydantic import ValidationError

from crosspih_common.bus.authors import NOBODY, Authors, names_of
from crosspih_common.bus.clock import BusClock
from crosspih_common.bus.codec import (
    SEQ_DIGITS,
    decoder_of,
    label_of,
    most_bytes,
    number_of,
    split_label,
    validator_without_text,
    why_invalid,
)
from crosspih_common.bus.traffic import MAX_KEYS, KeyCounters, Traffic
from crosspih_common.bus.transport import AuthoredHandler, Tap
from crosspih_common.errors import ContractError
from crosspih_common.keys import Payload, Topic
from crosspih_common.messages import CellClock

PayloadT = TypeVar("PayloadT", bound=Payload)


class Receiving:
    """Makes the callbacks of subscriptions. A callback is built once with all that is the same for every sample, and
    makes few further calls, because it runs for each sample. `reject` is called with (key, why)."""

    def __init__(self, authors: Authors, traffic: Traffic, clock: BusClock, reject: Callable[[str, str], None]) -> None:
        self._authors, self._traffic, self._clock, self._reject = authors, traffic, clock, reject

    def tapped(
        self, topic: Topic[Any], taker: Callable[[str, KeyCounters], Tap], on_refused: Callable[[str], None]
    ) -> AuthoredHandler:
        """See Bus.tap."""
        expected, names = label_of(topic.type), names_of(topic.publisher, topic.path)
        counted, most, digits = f"{expected} ", most_bytes(topic.type), len(expected) + 1
        first, rightful = names[0] if names else "", self._authors.rightful
        takers: dict[str, tuple[KeyCounters, Tap]] = {}

        def take(key: str, payload: bytes, label: str) -> None:
            counts, put = takers.get(key) or (self._traffic.of(key), None)
            if put is None:
                put = taker(key, counts)
                if len(takers) < MAX_KEYS:  # a sender can invent keys where its name is part of the key
                    takers[key] = counts, put
            counts.received += 1
            put(payload, number_of(label[digits:]))

        def receive(key: str, payload: bytes, label: str, author: str) -> None:
            if not label.startswith(counted) and label != expected:
                name = split_label(label)[0]
                self._reject(key, f"{key}: got {name[:80] or 'no type name'}, want {expected}")
                on_refused(key)
            elif len(payload) > most:
                self._reject(key, f"{key}: got {len(payload)} bytes, {most} are allowed")
            elif author in rightful.get(first, NOBODY) or not names:
                if (taking := takers.get(key)) is None or not (number := label[digits:]).isdecimal():
                    take(key, payload, label)
                else:  # the same, for nearly all samples, without a further call
                    taking[0].received += 1
                    taking[1](payload, int(number) if len(number) <= SEQ_DIGITS and number.isascii() else -1)
            elif self._authors.speaks(names, author, id(taker), key, lambda: take(key, payload, label)):
                take(key, payload, label)

        return receive

    def typed(self, topic: Topic[PayloadT], push: Callable[[PayloadT], None]) -> AuthoredHandler:
        """Decodes, counts, learns the cell's time, and calls `push`."""
        names, decode_one = names_of(topic.publisher, topic.path), decoder_of(topic.type)
        first, rightful = names[0] if names else "", self._authors.rightful
        expected, most, validate = label_of(topic.type), most_bytes(topic.type), validator_without_text(topic.type)
        counted, counts_of, known = f"{expected} ", self._traffic.of, dict[str, KeyCounters]()
        clock, is_tick = self._clock, topic.type is CellClock

        def take(key: str, value: PayloadT) -> None:
            counts = known.get(key)
            if counts is None:
                counts = counts_of(key)
                if len(known) < MAX_KEYS:
                    known[key] = counts
            counts.received += 1
            stamp_ns = value.stamp_ns
            if is_tick and isinstance(value, CellClock) and stamp_ns >= 0:
                clock.observe(stamp_ns, value.boot_id)
            elif stamp_ns > clock.newest_ns:
                clock.observe(stamp_ns)
            push(value)

        def receive(key: str, payload: bytes, label: str, author: str) -> None:
            try:
                if validate is not None and label.startswith(counted) and len(payload) <= most:
                    value = validate(payload)
                else:
                    value = decode_one(payload, label, key)
            except ValidationError as error:
                self._reject(key, why_invalid(error, expected, key))
                return
            except ContractError as error:
                self._reject(key, str(error))
                return
            if (
                author in rightful.get(first, NOBODY)
                or not names
                or self._authors.speaks(names, author, id(push), key, lambda: take(key, value))
            ):
                take(key, value)

        return receive
