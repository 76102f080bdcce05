"""A link between routers that hangs is told from one that is whole, and from one that is cut."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from crosspih_common.keys import router_key
from services.router.links import HANGS_S, Links

THERE = "b2"


@dataclass
class Reply:
    ok: object | None = None


@dataclass
class FakeSession:
    """What Links asks of a Zenoh session, whose own part no test can make hang at will."""

    linked: list[str] = field(default_factory=lambda: [THERE])
    answers: bool = True

    @property
    def info(self) -> FakeSession:
        return self

    def routers_zid(self) -> list[str]:
        return self.linked

    def zid(self) -> str:
        return "a1"

    def declare_queryable(self, key: str, handler: Any, complete: bool) -> None:
        assert key == router_key("a1") and complete

    def get(self, key: str, timeout: float) -> list[Reply]:
        assert key == router_key(THERE)
        return [Reply(object())] if self.answers else []


@dataclass
class Clock:
    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def links(session: FakeSession, clock: Clock) -> Links:
    return Links(session, clock)  # type: ignore[arg-type]


def test_one_that_answers_never_hangs(clock: Clock) -> None:
    asked = links(FakeSession(), clock)
    for clock.now_s in (0.0, HANGS_S, 10.0 * HANGS_S):
        assert asked.hanging() == ""


def test_one_that_is_linked_and_silent_for_longer_than_the_lease_hangs(clock: Clock) -> None:
    session = FakeSession()
    asked = links(session, clock)
    assert asked.hanging() == ""
    session.answers = False
    clock.now_s = HANGS_S
    assert asked.hanging() == ""
    clock.now_s = HANGS_S + 0.1
    assert asked.hanging() == THERE


def test_one_that_zenoh_has_given_up_does_not_hang(clock: Clock) -> None:
    session = FakeSession(answers=False)
    asked = links(session, clock)
    asked.hanging()
    session.linked = []
    clock.now_s = 2.0 * HANGS_S
    assert asked.hanging() == ""
    session.linked = [THERE]
    clock.now_s = 3.0 * HANGS_S
    assert asked.hanging() == "", "its silence counts from when it was linked anew"
