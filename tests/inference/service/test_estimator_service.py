"""The service's new answers over an in-memory bus: advice on a stalled insertion, and the touch of most information."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.keys import ADVISE_INSERTION, NEXT_TOUCH, SEATED
from crosspih_common.messages import (
    AdviseInsertion,
    BoreContact,
    EstimateSeated,
    InsertionAction,
    NextTouch,
    PoseData,
    PosePrior,
    floats,
)
from crosspih_common.service.lifecycle import ServiceContext
from services.inference.config import InferenceConfig
from services.inference.shell.service import InferenceShell


@pytest.fixture(scope="module")
def cell() -> Iterator[ServiceContext]:
    """The caller's place on a bus with the inference service choosing touches by information."""
    hub, file = MemoryHub(), load_cell("deploy/cells/default.yaml")
    contexts = [
        ServiceContext(name, file, Bus(hub.transport(), file.workcell.name, name)) for name in ("inference", "operator")
    ]
    shell = InferenceShell(contexts[0], InferenceConfig(next_touch="information"))
    yield contexts[1]
    shell.close()
    for context in contexts:
        context.bus.close()


def test_a_peg_that_is_not_in_yet_is_refused_as_not_seated(cell: ServiceContext) -> None:
    workcell = cell.cell.workcell
    hole = workcell.hole_prior.pose_base_hole()
    short = hole @ Pose.from_translation([0.0, 0.0, -0.004 - workcell.peg.shape().taper_start_m])
    request = EstimateSeated(
        prior=PosePrior(pose_base_hole=PoseData.of(hole), covariance=floats(np.diag([1e-8] * 3 + [1e-5] * 3))),
        pose_base_peg=PoseData.of(short),
        joints_rad=workcell.home_joints_rad,
        wrench=(0.0,) * 6,
    )
    with pytest.raises(CommandRefused, match=r"the peg's body is 5\.0 mm short of the bore") as refusal:
        cell.bus.call(SEATED, request, 30.0)
    assert refusal.value.code == "not_seated"


def test_a_stalled_insertion_gets_advice(cell: ServiceContext) -> None:
    workcell = cell.cell.workcell
    hole = workcell.hole_prior.pose_base_hole()
    peg = workcell.peg.shape()
    depth = workcell.hole.chamfer_m + 0.006
    pose = hole @ Pose.from_translation([0.0, 0.0, depth - peg.taper_start_m])
    belief = PosePrior(pose_base_hole=PoseData.of(hole), covariance=floats(np.diag([1e-8] * 3 + [1e-5] * 3)))
    request = AdviseInsertion(
        belief=belief,
        pose_base_peg=PoseData.of(pose),
        joints_rad=workcell.home_joints_rad,
        wrench=(0.0, 0.0, -12.0, 0.0, 0.0, 0.0),
        push_force_n=12.0,
    )
    advice = cell.bus.call(ADVISE_INSERTION, request, 30.0)
    assert advice.contact in (BoreContact.WEDGED, BoreContact.JAMMED)
    assert advice.action is InsertionAction.BACK_OFF and advice.back_off_m > 0.0
    assert advice.entered_m == pytest.approx(0.006, abs=3e-4)
    free = cell.bus.call(ADVISE_INSERTION, request.model_copy(update={"wrench": (0.0,) * 6}), 30.0)
    assert (free.contact, free.action) == (BoreContact.FREE, InsertionAction.CONTINUE)


def test_the_touch_of_most_information_starts_in_free_air(cell: ServiceContext) -> None:
    workcell = cell.cell.workcell
    hole = workcell.hole_prior.pose_base_hole()
    belief = PosePrior(
        pose_base_hole=PoseData.of(hole), covariance=floats(np.diag([1e-6, 1e-6, 4e-6, 1e-3, 1e-3, 1e-4]))
    )
    plan = cell.bus.call(NEXT_TOUCH, NextTouch(belief=belief, touches_made=1, failed_pushes=1), 30.0)
    tip = hole.inverse().apply(plan.pose_base_peg_start.pose().apply([0.0, 0.0, workcell.peg.shape().tip_m]))
    assert tip[2] < -0.004
    assert plan.idea == "estimate" or plan.idea.startswith("arm")
