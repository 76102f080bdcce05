"""Refuses requests whose values are impossible in this cell, before any search starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TypeVar

import numpy as np
from pydantic import ValidationError

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.messages import PosePrior, Touch
from crosspih_common.wrench import refuse_implausible_wrench

RequestT = TypeVar("RequestT")
AnswerT = TypeVar("AnswerT")

MAX_PRIOR_M, MAX_PRIOR_RAD = 0.5, np.pi  # standard deviations: a wider prior carries no information
FAR_M = 0.5  # from the believed rim to the peg's tip: a touch farther away was on another object


def refuse_implausible_prior(prior: PosePrior, name: str) -> None:
    """Raises CommandRefused `implausible`. `name` is the field's, for the text."""
    sd = np.sqrt(np.asarray(prior.covariance).reshape(6, 6).diagonal())
    if sd[:3].max() > MAX_PRIOR_M or sd[3:].max() > MAX_PRIOR_RAD:
        raise CommandRefused(
            "implausible",
            f"{name}.covariance: its standard deviations are up to {sd[:3].max():.3g} m and {sd[3:].max():.3g} rad; "
            f"give at most {MAX_PRIOR_M:g} m and {MAX_PRIOR_RAD:.3g} rad",
        )


def refuse_implausible_peg(pose_base_peg: Pose, tip_m: float, pose_base_hole: Pose, name: str) -> None:
    """Raises CommandRefused `implausible` where the tip (`tip_m` along z of the peg) is nowhere near the hole."""
    away_m = float(np.linalg.norm(pose_base_peg.apply([0.0, 0.0, tip_m]) - pose_base_hole.translation_m))
    if away_m > FAR_M:
        raise CommandRefused(
            "implausible", f"{name}: the peg's tip is {away_m:.3g} m from the believed hole; at most {FAR_M:g} m can be"
        )


def refuse_implausible_touches(prior: PosePrior, touches: Sequence[Touch], tip_m: float) -> None:
    """Check a whole request. Raises CommandRefused `implausible`, which names the touch and its field."""
    refuse_implausible_prior(prior, "prior")
    hole = prior.pose_base_hole.pose()
    for index, touch in enumerate(touches):
        refuse_implausible_peg(touch.pose_base_peg.pose(), tip_m, hole, f"touches.{index}.pose_base_peg")
        refuse_implausible_wrench(touch.wrench, f"touches.{index}.wrench")
        refuse_implausible_wrench(touch.wrench_sd, f"touches.{index}.wrench_sd")


def refuse_implausible_answers(answer: Callable[[RequestT], AnswerT]) -> Callable[[RequestT], AnswerT]:
    """Wrap a handler: an answer that no message can hold (a hole more than 100 m away) is refused as `implausible`.

    Each number of a request may be possible in a cell while their combination is not.
    """

    @wraps(answer)
    def plausible(request: RequestT) -> AnswerT:
        try:
            return answer(request)
        except ValidationError as error:
            first = error.errors()[0]
            raise CommandRefused(
                "implausible",
                f"the poses, wrenches and covariances of this request lead to no pose of a cell: "
                f"{'.'.join(str(part) for part in first['loc'])} of the answer would be {first['input']!r:.40}; "
                f"{first['msg']}",
            ) from None

    return plausible
