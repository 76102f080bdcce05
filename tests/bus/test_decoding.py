"""What nobody should send: each payload is a message or a ContractError that names the field."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from crosspih_common.bus.codec import MAX_BYTES, decode, label_of, split_label
from crosspih_common.errors import ContractError
from crosspih_common.keys import topics
from crosspih_common.messages import (
    AdmittanceMove,
    CellClock,
    EstimatePose,
    GuardedMove,
    Image,
    MoveLinear,
    PosePrior,
    floats,
)
from services.operator.bench.reliability.fuzz.decoding import decode_all, kinds

POSE = {"position_m": [0.0, 0.0, 0.1], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}


def said(kind: type[Any], value: dict[str, Any]) -> str:
    with pytest.raises(ContractError) as error:
        decode(kind, json.dumps(value).encode(), label_of(kind), "a/key")
    return str(error.value)


@pytest.mark.parametrize("key", sorted(kinds()))
def test_every_key_takes_or_rejects_whatever_comes(key: str) -> None:
    done = decode_all(key, kinds()[key], 60, seed=7)
    assert not done.escaped
    assert done.sent == 60
    assert done.accepted >= 5 and done.rejected >= 20, "the payloads are drawn from the schema, and broken"


def test_every_topic_of_the_table_is_among_them() -> None:
    assert set(kinds()) == {topic.path for topic in topics()}


@pytest.mark.parametrize(
    ("label", "seq"),
    [
        ("crosspih.CellClock/1 7", 7),
        ("crosspih.CellClock/1 ²", -1),  # a digit to Python, and no number
        ("crosspih.CellClock/1 " + "9" * 5000, -1),
        ("crosspih.CellClock/1 -3", -1),
        ("crosspih.CellClock/1", -1),
    ],
)
def test_a_label_whose_number_is_none_has_no_number(label: str, seq: int) -> None:
    assert split_label(label) == ("crosspih.CellClock/1", seq)


def test_a_zero_quaternion_is_refused_by_its_field() -> None:
    text = said(MoveLinear, {"pose_base_peg": {**POSE, "quaternion_xyzw": [0.0, 0.0, 0.0, 0.0]}})
    assert "pose_base_peg.quaternion_xyzw" in text and "unit quaternion" in text


def test_a_direction_without_length_is_refused_by_its_field() -> None:
    text = said(GuardedMove, {"direction_base": [0.0, 0.0, 0.0], "speed_m_s": 0.01, "travel_limit_m": 0.1})
    assert "direction_base" in text and "no length" in text


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda c: c - 2.0 * np.diag(c.diagonal()), "below 0"),
        (lambda c: np.ones((6, 6)) * 1e-6, "singular"),
        # their quotient overflows
        (lambda c: 5e-324 * np.eye(6) + 1e12 * (np.eye(6, k=1) + np.eye(6, k=-1)), "beyond all that its two variances"),
        (lambda c: np.zeros((6, 6)), "singular"),
        (lambda c: c + np.triu(np.full((6, 6), 1e-7), 1), "not symmetric"),
        (lambda c: c + 2e-6 * (np.ones((6, 6)) - np.eye(6)) * np.array([[-1.0] * 6] * 6), "negative eigenvalue"),
    ],
)
def test_a_covariance_that_is_none_is_refused_by_its_field(change: Any, why: str) -> None:
    covariance = change(np.diag([1e-6] * 6))
    text = said(PosePriorAsked, {"prior": {"pose_base_hole": POSE, "covariance": list(floats(covariance))}})
    assert "prior.covariance" in text and why in text


def test_absurd_times_and_numbers_are_refused_by_their_fields() -> None:
    assert "stamp_ns" in said(CellClock, {"stamp_ns": 10**30, "boot_id": "a", "realtime": True})
    assert "seq" in said(CellClock, {"seq": 2**60, "boot_id": "a", "realtime": True})
    move = {"direction_base": [0.0, 0.0, 1.0], "speed_m_s": 0.01, "travel_m": 0.01}
    assert "travel_m" in said(AdmittanceMove, {**move, "travel_m": 5e-324})
    far = {"time_s": 1.0, "offset_m": [1e11, 0.0, 0.0]}
    assert "path.0.offset_m" in said(AdmittanceMove, {**move, "path": [far]})
    assert "position_m" in said(MoveLinear, {"pose_base_peg": {**POSE, "position_m": [1e300, 0.0, 0.0]}})


def test_what_is_larger_than_any_message_is_not_read() -> None:
    payload = b"[" * (MAX_BYTES + 1)
    with pytest.raises(ContractError, match="bytes"):
        decode(CellClock, payload, label_of(CellClock), "a/key")
    # a picture may be larger, and this is none
    with pytest.raises(ContractError, match="not an image"):
        decode(Image, payload, label_of(Image), "a/key")


class PosePriorAsked(EstimatePose):
    """An estimate without touches, so that the prior alone is judged."""

    touches: tuple[()] = ()

    @classmethod
    def type_name(cls) -> str:
        return "crosspih.EstimatePose"


def test_a_sound_prior_is_taken() -> None:
    prior = PosePrior.model_validate({"pose_base_hole": POSE, "covariance": list(floats(np.diag([1e-6] * 6)))})
    assert prior.pose_base_hole.position_m == (0.0, 0.0, 0.1)
