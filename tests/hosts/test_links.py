"""A link between routers that hangs is told from one that is whole, and from one that is cut."""

from __future__ import annotations

import socket
from dataclasses import dataclass, field
from typing import Any

import pytest

from crosspih_common.keys import router_key
from services.router.links import LACKS_S, Links, reachable

THERE = "b2"


@dataclass
class FakeSession:
    """What Links asks of a Zenoh session, whose own part no test can make hang at will; and the time."""

    linked: list[str] = field(default_factory=lambda: [THERE])
    answers: bool = True
    cable: bool = True
    now_s: float = 0.0

    @property
    def info(self) -> FakeSession:
        return self

    def routers_zid(self) -> list[str]:
        return self.linked

    def zid(self) -> str:
        return "a1"

    def declare_queryable(self, key: str, handler: Any, complete: bool) -> None:
        assert key == router_key("a1") and complete

    def get(self, key: str, timeout: float) -> list[Any]:
        assert key == router_key(THERE)
        return [type("Reply", (), {"ok": object()})()] if self.answers else []


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture
def links(session: FakeSession) -> Links:
    return Links(session, ["tcp/10.0.0.1:7448"], lambda _: session.cable, lambda: session.now_s)  # type: ignore[arg-type]


def test_one_that_answers_never_hangs(session: FakeSession, links: Links) -> None:
    for session.now_s in (0.0, LACKS_S, 10.0 * LACKS_S):
        assert not links.hang()


@pytest.mark.parametrize("linked", [[], [THERE]])
def test_one_that_answered_once_and_is_silent_for_too_long_hangs(
    session: FakeSession, links: Links, linked: list[str]
) -> None:
    assert not links.hang()
    session.answers, session.linked, session.now_s = False, linked, LACKS_S
    assert not links.hang()
    session.now_s = LACKS_S + 0.1
    assert links.hang()
    session.answers, session.linked = True, [THERE]
    assert not links.hang()


def test_one_that_is_cut_or_never_was_there_does_not_hang(session: FakeSession, links: Links) -> None:
    session.answers, session.now_s = False, 10.0 * LACKS_S
    assert not links.hang(), "it never answered"
    session.answers = True
    assert not links.hang()
    session.answers, session.cable, session.now_s = False, False, 20.0 * LACKS_S
    assert not links.hang(), "its cable is out"


def test_an_address_can_be_reached_where_somebody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        there = f"tls/127.0.0.1:{server.getsockname()[1]}"
        assert reachable([there])
    assert not reachable([there]) and not reachable(["nonsense"])
