"""docs/wire.md is what its generator makes of today's source, and leaves nothing out."""

from __future__ import annotations

import re

import pytest

from crosspih_common.bus.codec import label_of
from crosspih_common.keys import commands, topics
from crosspih_common.messages import Message
from crosspih_common.refusals import REFUSALS
from docs import make_wire


def test_the_page_is_up_to_date() -> None:
    assert make_wire.PAGE.read_text(encoding="utf-8") == make_wire.page(), "make it anew: python -m docs.make_wire"


def test_the_page_has_every_message_key_and_refusal() -> None:
    page = make_wire.page()
    echoes = {f"{command.path}/{end}" for command in commands() for end in ("request", "reply")}
    for path in {topic.path for topic in topics()} - echoes | {command.path for command in commands()}:
        assert f"| `{path}` |" in page, path
    for topic in topics():
        if issubclass(topic.type, Message):
            assert f"### {label_of(topic.type)}\n" in page
    for code in REFUSALS:
        assert f"| `{code}` |" in page, code
    headings = {
        re.sub(r"[^a-z0-9 -]", "", line.lower()).strip().replace(" ", "-")
        for line in re.findall(r"(?m)^##+ (.*)$", page)
    }
    assert set(re.findall(r"\]\(#([^)]*)\)", page)) <= headings


def test_every_served_command_has_its_lane() -> None:
    lanes = make_wire.lanes()
    assert len({row[0] for row in lanes}) == len(lanes) >= 25
    assert ("`arm/stop`", "now", "waits its turn") in lanes
    assert ("`arm/dwell`", "arm", "refused as `busy`") in lanes
    assert ("`planning/assemble`", "work", "refused as `busy`") in lanes
    assert {row[1].split(";")[0] for row in lanes} == {"arm", "now", "work"}


def test_a_number_that_is_gone_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(make_wire.NUMBERS, "filter_hz", [("control/admittance", "NO_SUCH", 1)])
    with pytest.raises(make_wire.PageError, match=r"filter_hz.*NO_SUCH"):
        make_wire.numbers()
