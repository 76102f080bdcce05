"""What is counted as lost, and what is not: holes, late samples, restarts, forged numbers; and when it matters."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.keys import Kind
from crosspih_common.recording.numbering import JUMP
from services.recorder.losses import warnings_of
from services.recorder.tally import Tally

PERIOD_S = 0.01
RATE_HZ = 100.0


def heard(numbers: list[int], period_s: float = PERIOD_S) -> Tally:
    tally = Tally()
    for index, number in enumerate(numbers):
        tally.arrived("k", number, index * period_s, RATE_HZ)
    return tally


def lost(numbers: list[int]) -> int:
    return heard(numbers).lost().get("k", 0)


def test_one_forged_number_is_no_loss() -> None:
    for at in (0, 3, 10):
        numbers = list(range(10))
        numbers.insert(at, 10**12)
        if at:
            assert lost(numbers) == 0
        assert lost(numbers) <= JUMP
    assert lost([*range(10), 2**63 - 1, *range(10, 20)]) == 0


def test_many_forged_numbers_are_no_losses() -> None:
    numbers = list(range(1000))
    for at in range(990, 0, -7):
        numbers.insert(at, 10**12 + at**3)
    assert lost(numbers) == 0
    strays = heard(numbers).counts()["strays"]["k"]
    assert strays == len(range(990, 0, -7))
    # also where they count on: then the publisher seems to be started again, and nothing is lost
    two = heard([*range(100), 10**12, 10**12 + 1, *range(100, 200)])
    assert two.lost() == {} and two.counts()["restarts"]["k"] == 2


def test_a_gap_is_counted_when_the_numbers_go_on_behind_it() -> None:
    tally = heard([*range(10)])
    for seq in range(2010, 2020):  # after 20 s of silence
        tally.arrived("k", seq, 20.0 + seq * PERIOD_S, RATE_HZ)
    assert tally.lost() == {"k": 2000}
    # more than can have been sent in that time is another publisher
    assert heard([*range(10), *range(200_000, 200_010)]).lost() == {}


def test_late_samples_fill_their_hole() -> None:
    assert lost([0, 1, 5, 3, 2, 4, 6]) == 0
    assert lost([0, 1, 5, 2, 6, 7]) == 2
    assert lost([0, 1, 1, 2, 2, 3]) == 0  # twice is not lost


def test_a_stray_before_a_recording_is_no_less_than_none_in_it() -> None:
    tally = heard([100, 101, 0])
    tally.begin()
    tally.arrived("k", 1, 1.0, RATE_HZ)
    assert tally.metadata()["strays_total"] == "0"
    assert tally.metadata()["restarts_total"] == "1"


def test_a_publisher_that_begins_again() -> None:
    again = heard([*range(500), *range(300)])
    assert again.lost() == {} and again.counts()["restarts"] == {"k": 1}
    # one that lost its first samples, and one that had lost some before
    assert heard([*range(500), *range(5, 300)]).lost() == {}
    assert lost([0, 1, 4, 5, 0, 1, 2, 3, 4, 5, 6, 7, 8]) == 2


@settings(max_examples=50)
@given(
    st.integers(50, 300),
    st.sets(st.integers(1, 299), max_size=30),
    st.lists(st.tuples(st.integers(0, 300), st.integers(10**6, 10**18)), max_size=20),
    st.lists(st.integers(1, 299), max_size=20),
)
def test_what_is_lost_is_what_never_came(
    count: int, missing: set[int], forged: list[tuple[int, int]], swapped: list[int]
) -> None:
    """Of a publisher's numbers some never come, neighbours may overtake each other, and forged ones lie between."""
    numbers = [number for number in range(count) if number not in missing]
    last = numbers[-1]
    for at in swapped:
        if 1 < at < len(numbers) - 1:  # the first tells where they begin
            numbers[at - 1], numbers[at] = numbers[at], numbers[at - 1]
    for at, number in forged:
        numbers.insert(max(1, min(at, len(numbers))), number)
    tally = heard(numbers)
    # a forged number that is followed by its successor is believed to be a restart; these are far apart
    if not any(after == before + 1 and before > last for before, after in pairwise(numbers)):
        assert tally.lost().get("k", 0) == len([number for number in missing if numbers[0] < number <= last])


@settings(max_examples=50)
@given(st.lists(st.integers(0, 10**15), max_size=200))
def test_no_numbers_can_say_that_more_was_lost_than_can_have_been_sent(numbers: list[int]) -> None:
    assert 0 <= lost(numbers) <= len(numbers) * (JUMP + 4 * RATE_HZ * PERIOD_S)


def test_what_matters_is_said_and_what_does_not_is_not() -> None:
    kinds = {"crosspih/c/arm/joint_state": Kind.STREAM, "crosspih/c/planning/phase": Kind.EVENT}
    tally = Tally()
    assert warnings_of(tally.counts(), kinds) == {}
    for seq in range(0, 20_000):
        if seq not in (7, 8, 9):  # three of twenty thousand joint states
            tally.arrived("crosspih/c/arm/joint_state", seq, seq * 0.004, 250.0)
    assert tally.lost() and warnings_of(tally.counts(), kinds) == {}
    tally.arrived("crosspih/c/planning/phase", 0, 80.0)
    tally.arrived("crosspih/c/planning/phase", 2, 80.1)
    assert warnings_of(tally.counts(), kinds) == {
        "samples_missing": "1 sample never came here over the bus (planning/phase)"
    }
    for _ in range(3):
        tally.count("overflow", "crosspih/c/arm/joint_state")
    tally.count("unwritten", "crosspih/c/planning/phase")
    tally.count("refused", "crosspih/c/planning/phase")
    said = warnings_of(tally.counts(), kinds)
    assert set(said) == {"samples_missing", "samples_dropped", "samples_rejected"}
    assert "4 samples did not get into the recording" in said["samples_dropped"]
    assert "(most of arm/joint_state: 3; of 2 keys in all)" in said["samples_dropped"]
    tally.begin()
    assert warnings_of(tally.counts(), kinds) == {}
