"""Verdicts with known answers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crosspih_common.geometry import Pose
from services.operator.bench.pictures.judging.verdicts import figures, judged, least_off

TRUE = Pose.from_rotvec([0.2, -0.1, 0.3], [0.4, -0.3, 0.2])


def answer(pose: Pose | None, sd: float = 1e-4) -> dict[str, Any]:
    return {
        "located": pose is not None,
        "pose_base_hole": None if pose is None else pose.matrix().tolist(),
        "covariance": None if pose is None else (np.eye(6) * sd**2).tolist(),
        "refusal": None if pose is not None else {"code": "no_rim", "text": "light it"},
        "time_s": 0.1,
        "quality": {},
    }


def shifted(x_m: float) -> Pose:
    return TRUE @ Pose.from_translation([x_m, 0.0, 0.0])


@pytest.mark.parametrize(("order", "turn"), [(4, np.pi / 2), (1, 0.0), (0, 1.234), (5, 2 * np.pi / 5)])
def test_turns_that_look_the_same_are_no_error(order: int, turn: float) -> None:
    found = TRUE @ Pose.from_rotvec([0.0, 0.0, turn], [1e-4, 0.0, 0.0])
    error = least_off(found, TRUE, order)
    assert np.linalg.norm(error[:3]) == pytest.approx(1e-4)
    assert np.allclose(error[3:], 0.0, atol=1e-9)


def test_a_quarter_turn_of_a_key_is_an_error() -> None:
    found = TRUE @ Pose.from_rotvec([0.0, 0.0, np.pi / 2], [0.0, 0.0, 0.0])
    assert abs(least_off(found, TRUE, 1)[5]) == pytest.approx(np.pi / 2)


def test_what_counts_as_sure_and_wrong() -> None:
    right = judged(answer(shifted(1e-4)), "a", "row", TRUE, 4)
    far = judged(answer(shifted(6e-4)), "b", "row", TRUE, 4)  # six standard deviations: beyond 27.86
    no_hole = judged(answer(TRUE), "c", "row", None, 4)
    refused = judged(answer(None), "d", "row", TRUE, 4)
    assert [one.wrong for one in (right, far, no_hole, refused)] == [False, True, True, False]
    assert right.nees == pytest.approx(1.0)
    row = figures("row", [right, far, no_hole, refused])
    assert (row.pairs, row.holes, row.located, row.wrong) == (4, 3, 3, 2)
    assert row.refusals == {"no_rim": 1}
    assert row.lateral_mm == pytest.approx((0.35, 0.575))
    assert row.in_95_region == pytest.approx(0.5)


def test_a_covariance_that_is_none_is_wrong() -> None:
    bad = answer(TRUE) | {"covariance": np.full((6, 6), np.nan).tolist()}
    assert judged(bad, "a", "row", TRUE, 4).wrong
