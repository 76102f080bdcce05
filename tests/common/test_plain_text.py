"""What strangers write is shown as text: no escape of a terminal, no turned line, no end of a line, no end at all."""

from __future__ import annotations

import json
from unicodedata import category

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.bus.codec import decode, decode_refusal, encode, label_of
from crosspih_common.bus.traffic import MAX_KEYS, OTHERS, Traffic
from crosspih_common.errors import ContractError
from crosspih_common.messages import AssemblyPhase, Event, Phase, Severity
from crosspih_common.plain_text import is_plain_json, plain

OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")
HOSTILE = ["\x1b[2J", "\x1b]52;c;cm0gLXJm\x07", "\x9b31m", "\x7f", "\b\b\b", "\u202egnp", "\u200b", "\u2028", "\ufeff"]


@given(st.text(st.characters() | st.sampled_from("".join(HOSTILE)), max_size=60), st.integers(10, 80))
def test_nothing_that_a_terminal_obeys_is_left(text: str, most: int) -> None:
    line = plain(text, most)
    assert len(line) <= most and not [one for one in line if category(one) in OBEYED]
    assert plain(line, most) == line
    if not [one for one in text if category(one) in OBEYED] and len(text) <= most:
        assert line == " ".join(text.split())


@given(st.text(st.characters(exclude_categories=["Cs"]) | st.sampled_from('\\"u001b'), max_size=30), st.booleans())
def test_json_is_judged_by_its_strings_however_they_are_escaped(text: str, ascii_only: bool) -> None:
    payload = json.dumps({"text": text}, ensure_ascii=ascii_only).encode()
    inside = [one for one in text if category(one) in OBEYED and one not in "\n\r\t"]
    assert is_plain_json(payload) == (not inside)
    nested = json.dumps([{"deep": [text]}, {text: 1}], ensure_ascii=ascii_only).encode()
    assert is_plain_json(nested) == (not inside)


@pytest.mark.parametrize("hostile", HOSTILE)
@pytest.mark.parametrize("ascii_only", [True, False])
def test_a_message_that_would_command_a_terminal_is_rejected(hostile: str, ascii_only: bool) -> None:
    fields = {"stamp_ns": 1, "seq": 1, "assembly_id": "a", "phase": Phase.IDLE.value, "text": f"seen {hostile} there"}
    payload = json.dumps(fields, ensure_ascii=ascii_only).encode()
    with pytest.raises(ContractError, match="control characters"):
        decode(AssemblyPhase, payload, label_of(AssemblyPhase), "c/planning/phase")


def test_what_a_service_says_of_a_stranger_arrives_and_is_one_line() -> None:
    said = Event(service="vision", severity=Severity.WARNING, code="rejected", text="got \x1b[2J\nerror: all is well")
    assert said.text == "got \\x1b[2J error: all is well"
    assert decode(Event, encode(said), label_of(Event), "key") == said
    assert decode_refusal(b"\x1b[2J\nline\nline \xff").text == "line line \ufffd"


def test_the_name_of_a_field_that_there_is_not_is_told_in_short() -> None:
    payload = json.dumps({"x\x1b[2J" * 100_000: 1}).encode()
    with pytest.raises(ContractError) as caught:
        decode(Event, payload, label_of(Event), "key")
    assert len(str(caught.value)) < 2000 and "\x1b" not in str(caught.value)


def test_keys_that_somebody_invents_are_counted_together() -> None:
    traffic = Traffic()
    for number in range(10 * MAX_KEYS):
        traffic.of(f"crosspih/c/service/invented{number}/event").received += 1
        traffic.reject(f"crosspih/c/service/invented{number}/status", "why")
    rows = {row.key: row for row in traffic.snapshot()}
    assert len(rows) == MAX_KEYS + 1 and rows[OTHERS].received + MAX_KEYS // 2 == 10 * MAX_KEYS
    assert traffic.total("rejected") == 10 * MAX_KEYS
