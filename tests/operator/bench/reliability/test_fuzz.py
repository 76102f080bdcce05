"""The fuzz bench's own book-keeping: its shares, what a store gives back, and its tables."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest
from rich.console import Console

from crosspih_common.provenance import ResultStore
from services.operator.bench.reliability.fuzz import rests_on
from services.operator.bench.reliability.fuzz.attacking import AFTERWARDS, AttackedPart, parts
from services.operator.bench.reliability.fuzz.decoding import Decoded, decode_share, kinds, shares
from services.operator.bench.reliability.fuzz.decoding_all import AllDecoded, decode_every_key, share_key
from services.operator.bench.reliability.fuzz.rests_on import part_key, services_behind
from services.operator.bench.reliability.fuzz.tables import Attacked, markdown, part_rows, summary


def test_shares_hold_every_payload_once_and_all_keys_come_first() -> None:
    made = shares(250, 100, seed=3)
    assert {share.key for share in made[: len(kinds())]} == set(kinds())
    for key in kinds():
        of_key = [
            number for share in made if share.key == key for number in range(share.first, share.first + share.payloads)
        ]
        assert of_key == list(range(250))


def test_equal_shares_are_decoded_to_equal_counts_and_others_are_other_payloads() -> None:
    first, second = (share for share in shares(120, 60, seed=3) if share.key == "arm/move_linear/request")
    once, again = (decode_share(first, 0).decoded for _ in range(2))
    assert once == again and once.sent == 60
    assert share_key(first) != share_key(second) != share_key(second._replace(seed=4))


def test_what_a_store_holds_is_not_decoded_again(tmp_path: Path) -> None:
    console = Console(quiet=True)
    with ResultStore(tmp_path / "fuzz.jsonl") as store:
        for share in shares(3, 2000, seed=3):
            store.put(share_key(share), vars(Decoded(share.key, 1, 2)))
        done, interrupted = decode_every_key(console, 3, 3, math.inf, store)
    assert done.whole and not interrupted and done.sent == 3 * len(kinds())


def test_when_the_time_is_up_there_are_counts_of_what_was_done() -> None:
    done, interrupted = decode_every_key(Console(quiet=True), 100_000, 3, time.time() - 1.0)
    assert not done.whole and not interrupted and done.sent == 0


def test_each_command_and_topic_is_a_part_and_the_page_has_its_counts() -> None:
    assert len(parts()) == len(set(parts())) and parts()[-1] == AFTERWARDS
    answers = {"accepted": 3, "contract": 5, "implausible": 2, "internal": 1}
    attacked = Attacked(
        [
            AttackedPart(what="arm/dwell", answers=answers, defects=["internal: ..."], memory_mb={"vision": 100.0}),
            AttackedPart(what="clock", samples=40, tracebacks={"vision": 2}, memory_mb={"vision": 101.5}),
            AttackedPart(what=AFTERWARDS, answers={"inserted": 1}, memory_mb={"vision": 102.0}),
        ]
    )
    assert part_rows(attacked) == [("arm/dwell", 11, 3, 7, 1, 0, 0), ("clock", 40, 0, 0, 0, 0, 1)]
    assert attacked.grown_mb == {"vision": 2.0} and len(attacked.defects) == 2
    page = markdown(AllDecoded(), attacked, 0, 40, 1)
    assert "| `arm/dwell` | 11 | 3 | 7 | 1 | 0 | 0 |" in page and "the assembly afterwards inserted; 2 defects" in page
    assert "51 sent to 2 commands and topics" in summary(AllDecoded(), attacked, 2)


def test_a_part_rests_on_who_answers_and_who_is_asked_in_turn() -> None:
    assert services_behind("inference/estimate") == {"inference"}
    assert services_behind("vision/locate") == {"vision", "hardware"}
    assert services_behind("planning/assemble") == {"planning", "hardware", "vision", "force_torque", "inference"}
    assert services_behind("arm/lease") == {"planning", "recorder"}  # who reads it, of those that are in the cell
    assert all(services_behind(part) for part in parts())


def test_work_on_one_service_leaves_the_others_results(monkeypatch: pytest.MonkeyPatch) -> None:
    changed: set[str] = set()
    monkeypatch.setattr(rests_on, "folder_version", lambda folder: f"{folder} {folder in changed}")
    monkeypatch.setattr(rests_on, "code_version", lambda: str(changed))

    def keys() -> dict[str, str]:
        return {part: part_key(part, 10, 1, {"cell": {}}) for part in parts()}

    before = keys()
    changed.add("services/vision")
    after = keys()
    other = {part for part in parts() if before[part] != after[part]}
    assert other == {part for part in parts() if "vision" in services_behind(part)} and AFTERWARDS in other
    changed.add("crosspih_common")
    assert not set(after.values()) & set(keys().values())
    assert part_key("clock", 10, 1, {}) not in (part_key("clock", 11, 1, {}), part_key("clock", 10, 1, {"vision": {}}))
