"""The ways to send samples from one process to another, with the same payload size.

Each sample contains its number: as its stamp where it is a message, as the first eight bytes where it is plain bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import zenoh

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.bus.codec import encode
from crosspih_common.bus.zenoh_transport import client_config
from crosspih_common.keys import JOINT_STATE
from crosspih_common.messages import JointState
from services.operator.bench.speed.bus import others

CELL = "bench-bus"
TOPIC = JOINT_STATE  # the key on a bus of this bench's own
NUMBER = struct.Struct("<q")
SPEEDS = (0.011, -0.022, 0.033, -0.044, 0.055, -0.066)

Heard = Callable[[int], None]


@dataclass(frozen=True, slots=True, eq=False)
class BusWay:
    """`listen(endpoint, heard, stack)` calls `heard` with each sample's number; `send(endpoint, stack)` gives a
    function that sends one sample, and `sample(number)` makes it. `heard` is called on the transport's own thread.
    """

    name: str
    listen: Callable[[str, Heard, ExitStack], None]
    send: Callable[[str, ExitStack], Callable[[Any], object]]
    sample: Callable[[int], Any]


def message(number: int) -> JointState:
    """A joint state of six joints whose stamp is its number; each has angles of its own."""
    joints = tuple(0.1234567890123 * (joint + 1) + 1e-6 * number for joint in range(6))
    return JointState(stamp_ns=number, joints_rad=joints, speeds_rad_s=SPEEDS)


PAYLOAD_BYTES = len(encode(message(10_000)))


def plain(number: int) -> bytes:
    """As many bytes as such a message has on the wire."""
    return NUMBER.pack(number) + bytes(PAYLOAD_BYTES - NUMBER.size)


def number_of(payload: bytes) -> int:
    """The number in bytes made by `plain`."""
    return int(NUMBER.unpack_from(payload)[0])


# ------------------------------------------------------------------------------------------------- Zenoh by itself


def _session(endpoint: str, stack: ExitStack) -> zenoh.Session:
    session = zenoh.open(client_config(endpoint, 10.0))
    stack.callback(session.close)
    return session


def _raw_send(key: str) -> Callable[[str, ExitStack], Callable[[Any], object]]:
    def send(endpoint: str, stack: ExitStack) -> Callable[[Any], object]:
        publisher = _session(endpoint, stack).declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        if key.endswith("pydantic"):
            to_json = JointState.__pydantic_serializer__.to_json
            return lambda value: publisher.put(to_json(value))
        return lambda payload: publisher.put(payload)

    return send


def _raw_listen(key: str) -> Callable[[str, Heard, ExitStack], None]:
    def listen(endpoint: str, heard: Heard, stack: ExitStack) -> None:
        validate = JointState.__pydantic_validator__.validate_json

        def bare(sample: zenoh.Sample) -> None:
            heard(number_of(sample.payload.to_bytes()))

        def validated(sample: zenoh.Sample) -> None:
            heard(validate(sample.payload.to_bytes()).stamp_ns)

        _session(endpoint, stack).declare_subscriber(key, validated if key.endswith("pydantic") else bare)

    return listen


# ------------------------------------------------------------------------------------------------------- the typed bus


def _typed_send(cell: str) -> Callable[[str, ExitStack], Callable[[Any], object]]:
    def send(endpoint: str, stack: ExitStack) -> Callable[[Any], object]:
        bus = stack.enter_context(Bus(open_zenoh(endpoint), cell, TOPIC.publisher))
        return bus.publisher(TOPIC).publish

    return send


def _typed_listen(cell: str, own_thread: bool) -> Callable[[str, Heard, ExitStack], None]:
    def listen(endpoint: str, heard: Heard, stack: ExitStack) -> None:
        bus = stack.enter_context(Bus(open_zenoh(endpoint), cell, "planning"))
        if own_thread:
            bus.subscribe(TOPIC, lambda state: heard(state.stamp_ns), capacity=1_000_000)
        else:
            bus.subscribe_inline(TOPIC, lambda state: heard(state.stamp_ns))

    return listen


RAW = "raw Zenoh"
PYDANTIC = "raw Zenoh with pydantic-core"
TYPED = "crosspih, subscribe_inline"
PUMPED = "crosspih, subscribe"

HOUSE: Sequence[BusWay] = (
    BusWay(RAW, _raw_listen("bench/raw"), _raw_send("bench/raw"), plain),
    BusWay(PYDANTIC, _raw_listen("bench/pydantic"), _raw_send("bench/pydantic"), message),
    BusWay(TYPED, _typed_listen(CELL, own_thread=False), _typed_send(CELL), message),
    BusWay(PUMPED, _typed_listen(f"{CELL}-2", own_thread=True), _typed_send(f"{CELL}-2"), message),
)


def installed_ways() -> dict[str, BusWay]:
    """Those above, and the other buses whose packages are installed, by name."""
    found = [*HOUSE, *(BusWay(name, listen, send, plain) for name, listen, send in others.installed(number_of))]
    return {way.name: way for way in found}
