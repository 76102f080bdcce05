"""The typed bus of every service: publish, subscribe, call and serve commands, show that the service lives."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from crosspih_common.bus.authors import CLAIM_ARRIVES_S, Authors
from crosspih_common.bus.clock import BusClock
from crosspih_common.bus.codec import (
    MAX_BYTES,
    decode,
    decode_refusal,
    encode_refusal,
    encode_stamped,
    label_of,
)
from crosspih_common.bus.duty import JOB_S, NOW_S, Duty, waiting
from crosspih_common.bus.latest import Latest
from crosspih_common.bus.publisher import Publisher
from crosspih_common.bus.receiving import Receiving
from crosspih_common.bus.served import SERVER_WAIT_S
from crosspih_common.bus.traffic import KeyCounters, Traffic
from crosspih_common.bus.transport import Answer, Closeable, Query, Tap, Transport
from crosspih_common.bus.workers import Lane, Pump
from crosspih_common.errors import BusClosed, CommandRefused, ContractError, CrosspihError, NotSent
from crosspih_common.keys import CLOCK, REFUSAL, Command, Kind, Payload, Qos, Topic, alive_key
from crosspih_common.messages import CommandRefusal, Image, Message

PayloadT = TypeVar("PayloadT", bound=Payload)
RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)

HISTORY = {Kind.STATE: 64, Kind.EVENT: 64, Kind.STREAM: 0}  # for readers that missed some; a late one gets the newest
PICTURES_KEPT = 8  # pictures kept for each topic: one has up to 15 MB
MIN_DEADLINE_S = 0.05  # least time left for the answer after waiting for the server
WAITING_REFUSALS = 256
NOW_LANE = "now"  # for commands that must pass a busy lane: stop, abort


class Bus:
    """One service's connection to the bus. Closing it withdraws all declarations and ends all threads.

    It claims its service's name, so that others accept its samples (crosspih_common/bus/authors.py). With `claim`
    False it claims the name later, or only sends queries and subscribes.
    """

    def __init__(self, transport: Transport, cell: str, service: str, *, claim: bool = True) -> None:
        self.cell, self.service = cell, service
        self.clock = BusClock()
        self.traffic = Traffic()
        self.on_reject: Callable[[str], None] | None = None
        self.on_forged: Callable[[str], None] | None = None
        self._transport = transport
        self._declared: list[Closeable] = []
        self._lanes: dict[str, Lane] = {}
        self._duties: list[Duty] = []
        self._refused: Pump[CommandRefusal] | None = None
        self._publishers: dict[str, Publisher[Any]] = {}
        self._lock = threading.Lock()
        self._closed = False
        self.authors = Authors(transport, cell, self._forged)
        self._receiving = Receiving(self.authors, self.traffic, self.clock, self._reject)
        self._declared.append(self.authors)
        if claim:
            self._declared.append(self.authors.claim(service))
        if service != CLOCK.publisher:
            self._listen(CLOCK, lambda tick: None)

    @property
    def endpoint(self) -> str | None:
        """The address of the router of this bus; None for a bus in memory."""
        return self._transport.endpoint

    @property
    def closed(self) -> bool:
        """Whether the bus was closed; a closed bus receives nothing more."""
        return self._closed

    def __enter__(self) -> Bus:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    # ------------------------------------------------------------------------------------------------ publish, read

    def publisher(self, topic: Topic[PayloadT]) -> Publisher[PayloadT]:
        """The publisher of a topic; the same object each time, so that there is one sequence of numbers."""
        key = topic.key(self.cell, self.service)
        with self._lock:
            if key not in self._publishers:
                history = PICTURES_KEPT if topic.type is Image else HISTORY[topic.kind]
                sender = self._transport.sender(key, recover=topic.qos is Qos.RECOVER, history=history)
                self._publishers[key] = Publisher(topic, key, sender, self.clock, self.traffic.of(key))
                self._declared.append(sender)
            return self._publishers[key]

    def latest(self, topic: Topic[PayloadT], depth: int = 1) -> Latest[PayloadT]:
        """Keep the newest samples of a topic."""
        latest: Latest[PayloadT] = Latest(depth)
        self._listen(topic, latest._push)
        return latest

    @contextlib.contextmanager
    def reading(self, topic: Topic[PayloadT], depth: int = 1) -> Iterator[Latest[PayloadT]]:
        """As `latest`, for one block, with a new subscription: every publisher's last state arrives again."""
        latest: Latest[PayloadT] = Latest(depth)
        with self.subscribed(topic, latest._push):
            yield latest

    @contextlib.contextmanager
    def subscribed(self, topic: Topic[PayloadT], handler: Callable[[PayloadT], None]) -> Iterator[None]:
        """As `subscribe_inline`, for the length of a block."""
        entry = self._listen(topic, handler)
        try:
            yield
        finally:
            with contextlib.suppress(ValueError):  # the bus was closed meanwhile, and the subscription with it
                self._declared.remove(entry)
            entry.close()

    def subscribe(self, topic: Topic[PayloadT], handler: Callable[[PayloadT], None], capacity: int = 4096) -> None:
        """Call the handler with every sample, in order, on a thread of its own; samples that do not fit are counted."""
        pump: Pump[PayloadT] = Pump(
            handler, capacity, name=f"{self.service}:{topic.path}", on_error=self._handler_failed
        )
        self._declared.append(pump)
        self._duties.append(pump.duty)
        key = topic.key(self.cell)

        def enqueue(value: PayloadT) -> None:
            if not pump.offer(value):
                self.traffic.of(key).dropped += 1

        self._listen(topic, enqueue)

    def subscribe_inline(self, topic: Topic[PayloadT], handler: Callable[[PayloadT], None]) -> None:
        """Call the handler with every sample on the transport's own thread, without a queue: it must return at once."""
        self._listen(topic, handler)

    def tap(
        self,
        topic: Topic[Any],
        taker: Callable[[str, KeyCounters], Tap],
        on_refused: Callable[[str], None] = lambda key: None,
    ) -> None:
        """Receive the undecoded (payload, number) of every sample, on the transport's thread.

        `taker(key, counts)` returns the function that is called with the samples of a key; it must only enqueue. A
        sample of another type or version is rejected, as everywhere, and `on_refused` is called with its key.
        """
        receive = self._receiving.tapped(topic, taker, on_refused)
        self._declared.append(
            self._transport.subscribe(topic.key(self.cell), receive, recover=topic.qos is Qos.RECOVER)
        )

    def _listen(self, topic: Topic[PayloadT], push: Callable[[PayloadT], None]) -> Closeable:
        receive = self._receiving.typed(topic, push)
        entry = self._transport.subscribe(topic.key(self.cell), receive, recover=topic.qos is Qos.RECOVER)
        self._declared.append(entry)
        return entry

    def _forged(self, key: str, why: str) -> None:
        self.traffic.reject(key, why)
        if self.on_forged is not None:
            self.on_forged(why)

    def _reject(self, key: str, why: str) -> None:
        self.traffic.reject(key, why)
        if self.on_reject is not None:
            self.on_reject(why)

    def _handler_failed(self, error: Exception) -> None:
        if self.on_reject is not None:
            self.on_reject(f"a handler failed: {type(error).__name__}: {error}")

    # ------------------------------------------------------------------------------------------------- ask and serve

    def call(
        self, command: Command[RequestT, ReplyT], request: RequestT, deadline_s: float,
        server_wait_s: float = SERVER_WAIT_S,
    ) -> ReplyT:  # fmt: skip
        """Send a command and wait for its answer.

        If no service serves the command, or the router is away, this waits for up to `server_wait_s` of the deadline.
        Raises CommandRefused (the server refused it), CommandTimeout, NotSent (no server appeared, nothing was sent),
        NoService (the server ended without an answer), ContractError, BusClosed.
        """
        if self._closed:
            raise BusClosed(f"{command.path}: the bus is closed")
        key = command.key(self.cell)
        with waiting(deadline_s):
            return self._ask(command, key, request, deadline_s, server_wait_s)

    def _ask(
        self, command: Command[RequestT, ReplyT], key: str, request: RequestT, deadline_s: float, server_wait_s: float
    ) -> ReplyT:
        until = time.monotonic() + deadline_s
        if not self._transport.wait_served(key, min(deadline_s, server_wait_s)):
            raise NotSent(f"{key}: nobody answers; is the service that serves it up? (`crosspih ps`)")
        deadline_s = max(until - time.monotonic(), MIN_DEADLINE_S)
        payload = encode_stamped(request, self.clock.now_ns(), request.seq)
        answer = self._transport.query(key, payload, label_of(command.request), deadline_s)
        if answer.is_error:
            raise decode_refusal(answer.payload)
        reply = decode(command.reply, answer.payload, answer.label, key)
        self.clock.observe(reply.stamp_ns)
        return reply

    def serve(
        self,
        command: Command[RequestT, ReplyT],
        handler: Callable[[RequestT], ReplyT],
        *,
        lane: str = "work",
        refuse_when_busy: bool = False,
        on_accept: Callable[[], object] = lambda: None,
        on_end: Callable[[], object] = lambda: None,
        longest_s: float = JOB_S,
    ) -> None:
        """Answer a command. Commands of one lane are answered one after the other, on the lane's own thread.

        With `refuse_when_busy` a command that finds its lane at work is refused instead of queued: right for motions,
        where a command that waits would later move an arm that its sender has given up on. `on_accept` is called when
        it is accepted, before anything of it is read, and `on_end` when it has been answered. A lane that has been at
        one command for `longest_s` of wall time, the longest of its commands, counts as hung (duty.py).
        """
        key = command.key(self.cell)
        requests, replies = self.publisher(command.request_echo), self.publisher(command.reply_echo)
        refusals = self.publisher(REFUSAL)

        def handle(query: Query) -> Answer:
            number = -1
            try:
                if len(query.payload) > MAX_BYTES:
                    raise CommandRefused(
                        "size", f"{key}: the request has {len(query.payload)} bytes, {MAX_BYTES} are allowed"
                    )
                try:
                    request = decode(command.request, query.payload, query.label, key)
                except ContractError as error:
                    self._reject(key, str(error))
                    raise CommandRefused("contract", str(error)) from None
                if command.changes_calibration and not self.authors.claimed_by(
                    command.callers, query.author, CLAIM_ARRIVES_S
                ):
                    raise CommandRefused(
                        "not_yours",
                        f"{command.path} changes a calibration: only {' and '.join(command.callers)} may ask for it",
                    )
                self.traffic.of(key).received += 1
                self.clock.observe(request.stamp_ns)
                number, _ = requests.publish(request)
                _, reply = replies.publish(handler(request))
                return Answer(reply, label_of(command.reply), is_error=False)
            except CommandRefused as error:
                refusal = error
            except BusClosed:
                refusal = CommandRefused("stopping", f"{self.service} was stopped while it carried this out")
            except CrosspihError as error:
                refusal = CommandRefused(error.code, str(error))
            except Exception as error:
                # a defect in a handler must reach the caller and the log, and must not end the service
                refusal = CommandRefused("internal", f"{type(error).__name__}: {error}")
                self._handler_failed(error)
            said = CommandRefusal(command=command.path, request_seq=number, refused=refusal.code, text=refusal.text)
            with contextlib.suppress(CrosspihError):  # the bus is closing
                refusals.publish(said)
            return Answer(encode_refusal(refusal), "", is_error=True)

        def job(query: Query) -> Callable[[], None]:
            try:
                answer = handle(query)
            finally:
                on_end()
            return lambda: query.answer(answer)

        # this runs on the transport's thread, which must not publish
        echo = self._busy_echo(refusals) if refuse_when_busy else None
        worker = self._lane(lane, NOW_S if lane == NOW_LANE else longest_s)

        def accept(query: Query) -> None:
            on_accept()
            if not worker.offer(lambda: job(query), only_when_idle=refuse_when_busy):
                on_end()
                refusal = CommandRefused("busy", f"{command.path}: another command is still being carried out")
                query.answer(Answer(encode_refusal(refusal), "", is_error=True))
                said = CommandRefusal(command=command.path, refused=refusal.code, text=refusal.text)
                if echo is not None and not echo.offer(said):
                    self.traffic.of(refusals.key).dropped += 1

        self._declared.append(self._transport.serve(key, accept))

    def _lane(self, name: str, longest_s: float) -> Lane:
        with self._lock:
            if name not in self._lanes:
                self._lanes[name] = Lane(f"{self.service}:{name}", longest_s)
                self._duties.append(self._lanes[name].duty)
            lane = self._lanes[name]
            lane.longest_s = max(lane.longest_s, longest_s)
            return lane

    def _busy_echo(self, refusals: Publisher[CommandRefusal]) -> Pump[CommandRefusal]:
        if self._refused is None:
            name = f"{self.service}:refusals"
            self._refused = Pump(refusals.publish, WAITING_REFUSALS, name=name, on_error=lambda error: None)
            self._declared.append(self._refused)
            self._duties.append(self._refused.duty)
        return self._refused

    def duties(self) -> tuple[Duty, ...]:
        """The accounts of all threads of this bus that carry out commands or take samples."""
        return tuple(self._duties)

    @property
    def busy(self) -> bool:
        """Whether any command but those on the `now` lane is being carried out."""
        with self._lock:
            return any(lane.busy for name, lane in self._lanes.items() if name != NOW_LANE)

    # ---------------------------------------------------------------------------------------------------- be alive

    def declare_alive(self, name: str | None = None) -> None:
        """Show that this service lives, or (under another name) that a part of it does, such as the camera."""
        self._declared.append(self._transport.declare_alive(alive_key(self.cell, name or self.service)))

    def watch_alive(self, handler: Callable[[str, bool], None]) -> None:
        """Call with (service, True) for each that lives or comes, (service, False) for each that goes."""
        self._declared.append(
            self._transport.watch_alive(alive_key(self.cell), lambda key, alive: handler(key.split("/")[-2], alive))
        )

    def also_close(self, entry: Closeable) -> None:
        """Close this with the bus."""
        self._declared.append(entry)

    def close(self) -> None:
        """Withdraw all declarations, end all threads, close the transport. Safe to call twice."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            declared, self._declared = self._declared, []
            lanes = list(self._lanes.values())
        for entry in reversed(declared):
            with contextlib.suppress(CrosspihError):
                entry.close()
        for lane in lanes:
            lane.close()
        self._transport.close()


__all__ = ["NOW_LANE", "Bus", "Latest", "Publisher"]
