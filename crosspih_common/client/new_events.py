"""Keeps only new events: a late subscriber on the bus receives the last event of every service again."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from crosspih_common.bus.clock import AHEAD_NS, BusClock
from crosspih_common.messages import Event


def only_new(on_event: Callable[[Event], None], clock: BusClock, heard: Iterable[Event]) -> Callable[[Event], None]:
    """`on_event` without old events: those in `heard`, those stamped before now, and those of an earlier run of the
    cell, whose stamps are ahead of this run's clock. An event without a stamp counts as new."""
    begun_ns, boot_id = clock.now_ns(), clock.boot_id
    before = {(event.service, event.seq, event.stamp_ns) for event in heard}

    def new(event: Event) -> None:
        if event.stamp_ns >= 0:
            past = clock.boot_id == boot_id and event.stamp_ns < begun_ns
            if past or event.stamp_ns > clock.now_ns() + AHEAD_NS:
                return
            if (event.service, event.seq, event.stamp_ns) in before:
                return
        on_event(event)

    return new
