"""Who speaks for a service: what another says in its name is thrown away and told, on whatever carries the bus."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.bus.authors import MAX_HELD, PROCESS, Authors, SampleStanding, names_of
from crosspih_common.bus.codec import encode, label_of, label_with_seq
from crosspih_common.bus.memory import MemoryTransport
from crosspih_common.bus.transport import Closeable
from crosspih_common.keys import (
    CAMERA_CALIBRATION,
    FT_CALIBRATION,
    IDENTIFY_PAYLOAD,
    LEASE_BEAT,
    author_key,
)
from crosspih_common.messages import FtCalibration, IdentifyPayload
from tests.force_torque.made_calibrations import CALIBRATION, FORGED

CELL = "c"


class Stranger:
    """A session that nobody knows, or one that claims a name from a process of its own."""

    def __init__(self, hub: MemoryHub) -> None:
        self.transport = MemoryTransport(hub)

    def say(self, value: FtCalibration) -> None:
        sender = self.transport.sender(FT_CALIBRATION.key(CELL), recover=True, history=1)
        sender.put(encode(value), label_with_seq(FtCalibration, 0))

    def claim(self, name: str, process: str) -> None:
        self.transport.claim(author_key(CELL, name, process, self.transport.author))


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def planning(hub: MemoryHub) -> Iterator[Bus]:
    with Bus(hub.transport(), CELL, "planning") as bus:
        yield bus


@pytest.fixture
def forged(planning: Bus) -> list[str]:
    said: list[str] = []
    planning.on_forged = said.append
    return said


def test_a_forged_state_is_thrown_away_and_told(hub: MemoryHub, planning: Bus, forged: list[str]) -> None:
    latest = planning.latest(FT_CALIBRATION)
    with Bus(hub.transport(), CELL, "force_torque") as force_torque:
        force_torque.publisher(FT_CALIBRATION).publish(CALIBRATION)
        stranger = Stranger(hub)
        stranger.say(FORGED)
        assert (told := latest.value()) is not None and told.weight_n == CALIBRATION.weight_n
        assert len(forged) == 1 and stranger.transport.author in forged[0]
        assert FT_CALIBRATION.key(CELL) in forged[0]
        assert planning.traffic.total("rejected") == 1


def test_what_comes_before_its_claim_waits_for_it(hub: MemoryHub, planning: Bus, forged: list[str]) -> None:
    latest, stranger = planning.latest(FT_CALIBRATION, 2 * MAX_HELD), Stranger(hub)
    weights = [float(number) for number in range(MAX_HELD + 3)]
    for weight_n in weights:
        stranger.say(CALIBRATION.model_copy(update={"weight_n": weight_n}))
    assert latest.value() is None and not forged
    stranger.claim("force_torque", "one")
    assert [one.weight_n for one in latest.values()] == weights[-MAX_HELD:]


def test_what_was_held_is_told_when_another_claims_the_name(
    hub: MemoryHub, planning: Bus, forged: list[str]
) -> None:  # fmt: skip
    latest = planning.latest(FT_CALIBRATION)
    Stranger(hub).say(FORGED)
    with Bus(hub.transport(), CELL, "force_torque"):
        assert latest.value() is None
        assert len(forged) == 1


def test_what_nobody_claims_is_told_once(
    hub: MemoryHub, planning: Bus, forged: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    planning.latest(FT_CALIBRATION)
    stranger = Stranger(hub)
    monkeypatch.setattr("crosspih_common.bus.authors.HELD_TOO_LONG_S", -1.0)
    for _ in range(3):
        stranger.say(FORGED)
        planning.authors.tell_of_held()
    assert len(forged) == 1


def test_a_name_is_its_first_claimants_and_the_next_ones_when_that_is_gone(hub: MemoryHub) -> None:
    authors = Authors(MemoryTransport(hub), CELL, lambda key, why: None)
    first, second, beside = Stranger(hub), Stranger(hub), Stranger(hub)
    first.claim("vision", "one")
    beside.claim("vision", "one")  # another session of the same process
    second.claim("vision", "two")

    def standing(of: Stranger) -> SampleStanding:
        return authors.standing(("vision",), of.transport.author)

    assert [standing(of) for of in (first, beside, second)] == [
        SampleStanding.RIGHTFUL,
        SampleStanding.RIGHTFUL,
        SampleStanding.ANOTHER,
    ]
    first.transport.close()
    assert [standing(of) for of in (beside, second)] == [SampleStanding.RIGHTFUL, SampleStanding.ANOTHER]
    beside.transport.close()
    assert standing(second) is SampleStanding.RIGHTFUL
    second.transport.close()
    assert standing(second) is SampleStanding.UNCLAIMED


def test_operators_share_their_name(hub: MemoryHub) -> None:
    authors = Authors(MemoryTransport(hub), CELL, lambda key, why: None)
    one, two = Stranger(hub), Stranger(hub)
    one.claim("operator", "one")
    two.claim("operator", "two")
    assert authors.standing(("operator",), two.transport.author) is SampleStanding.RIGHTFUL


def test_who_may_publish_a_topic() -> None:
    assert names_of(CAMERA_CALIBRATION.publisher, CAMERA_CALIBRATION.path) == ("hardware", "camera")
    assert names_of(FT_CALIBRATION.publisher, FT_CALIBRATION.path) == ("force_torque",)
    assert names_of(LEASE_BEAT.publisher, LEASE_BEAT.path) == ()


def test_a_command_that_changes_a_calibration_is_not_everybodys(
    hub: MemoryHub, planning: Bus, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crosspih_common.bus.bus.CLAIM_ARRIVES_S", 0.0)
    with Bus(hub.transport(), CELL, "force_torque") as force_torque, Bus(hub.transport(), CELL, "vision") as vision:
        force_torque.serve(IDENTIFY_PAYLOAD, lambda request: CALIBRATION)
        asked = encode(IdentifyPayload(readings=())), label_of(IdentifyPayload)
        for transport in (Stranger(hub).transport, vision._transport):
            answer = transport.query(IDENTIFY_PAYLOAD.key(CELL), *asked, 5.0)
            assert answer.is_error and answer.payload.startswith(b"not_yours\n")
        assert planning.call(IDENTIFY_PAYLOAD, IdentifyPayload(readings=()), 5.0).weight_n == CALIBRATION.weight_n


def test_a_service_alone_claims_its_name_and_a_second_does_not(hub: MemoryHub) -> None:
    stop, other = threading.Event(), Stranger(hub)
    authors = Authors(hub.transport(), CELL, lambda key, why: None)
    other.claim("vision", "another process")
    assert authors.claim_alone("vision", 0.2, stop) is None
    other.transport.close()
    assert authors.claim_alone("vision", 0.2, stop) is not None
    assert hub.transport().living(author_key(CELL, "vision", PROCESS))


class TakenInLate(MemoryTransport):
    """A session just opened, as Zenoh's: its first questions are answered by its own process alone."""

    def __init__(self, hub: MemoryHub) -> None:
        super().__init__(hub)
        self.unheard = 2

    def living(self, key_expression: str) -> list[str]:
        self.unheard -= 1
        return [] if self.unheard >= 0 else super().living(key_expression)

    def watch_alive(self, key_expression: str, handler: Callable[[str, bool], None]) -> Closeable:
        return self._declared(lambda: None)


def test_an_answer_without_the_router_is_not_believed(hub: MemoryHub) -> None:
    Stranger(hub).claim("vision", "another process")
    authors = Authors(TakenInLate(hub), CELL, lambda key, why: None)
    assert authors.claim_alone("vision", 0.2, threading.Event()) is None


def test_a_service_waits_for_one_that_goes(hub: MemoryHub) -> None:
    other = Stranger(hub)
    other.claim("vision", "another process")
    authors = Authors(hub.transport(), CELL, lambda key, why: None)
    going = threading.Timer(0.1, other.transport.close)
    going.start()
    assert authors.claim_alone("vision", 10.0, threading.Event()) is not None
    going.join()
