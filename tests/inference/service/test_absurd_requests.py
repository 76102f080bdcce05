"""Requests drawn from their own schemas, absurd ones among them: each is answered or refused by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.bus.codec import decode, label_of
from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused, ContractError
from crosspih_common.geometry import Pose
from crosspih_common.keys import ADVISE_INSERTION, NETWORK, NEXT_TOUCH, SEATED, Command
from crosspih_common.messages import AdviseInsertion, EstimateSeated, PoseData, PosePrior, floats
from crosspih_common.service.lifecycle import ServiceContext
from services.inference.config import InferenceConfig
from services.inference.shell.service import InferenceShell
from services.operator.bench.reliability.fuzz.payloads import PayloadMaker, Sort


@pytest.fixture(scope="module")
def bus() -> Iterator[Bus]:
    """The caller's place on a bus with the inference service."""
    hub, file = MemoryHub(), load_cell("deploy/cells/default.yaml")
    contexts = [
        ServiceContext(name, file, Bus(hub.transport(), file.workcell.name, name)) for name in ("inference", "operator")
    ]
    shell = InferenceShell(contexts[0], InferenceConfig())
    yield contexts[1].bus
    shell.close()
    for context in contexts:
        context.bus.close()


@pytest.mark.parametrize(
    ("command", "count"), [(SEATED, 300), (ADVISE_INSERTION, 300), (NEXT_TOUCH, 300), (NETWORK, 20)]
)
def test_no_request_that_fits_its_schema_meets_a_defect(bus: Bus, command: Command[Any, Any], count: int) -> None:
    maker, answers = PayloadMaker(command.request.model_json_schema(), "absurd"), Counter[str]()
    for _ in range(count):
        try:
            request = decode(command.request, maker.payload(Sort.FITTING), label_of(command.request), "key")
        except ContractError:
            answers["contract"] += 1
            continue
        try:
            bus.call(command, request, 30.0)
            answers["answered"] += 1
        except CommandRefused as refusal:
            answers[refusal.code] += 1
    assert not set(answers) - {"answered", "contract", "implausible", "not_seated"}
    assert answers["answered"] >= count // 10, "the payloads get past the first check"


def _belief(hole: Pose) -> PosePrior:
    return PosePrior(pose_base_hole=PoseData.of(hole), covariance=floats(np.diag([1e-8] * 3 + [1e-5] * 3)))


def test_a_peg_across_its_hole_gets_no_advice(bus: Bus) -> None:
    cell = load_cell("deploy/cells/default.yaml").workcell
    hole, start_m = cell.hole_prior.pose_base_hole(), cell.peg.shape().taper_start_m
    # 80 degrees askew, the body's leading end 2 mm past the rim: along the peg's axis it is short of it
    across = hole @ Pose.from_translation([-0.03, 0.0, 0.002]) @ Pose.from_rotvec([0.0, np.deg2rad(80.0), 0.0], [0] * 3)
    pose = across @ Pose.from_translation([0.0, 0.0, -start_m])
    request = AdviseInsertion(
        belief=_belief(hole), pose_base_peg=PoseData.of(pose), joints_rad=cell.home_joints_rad, wrench=(0.0,) * 6,
        push_force_n=10.0,
    )  # fmt: skip
    with pytest.raises(CommandRefused, match="short of the bore") as refusal:
        bus.call(ADVISE_INSERTION, request, 30.0)
    assert refusal.value.code == "not_seated"


def test_what_leads_out_of_the_cell_is_refused_by_the_answers_field(bus: Bus) -> None:
    """A hole as far away as a message can say, and a peg that is pressed away from it."""
    cell = load_cell("deploy/cells/default.yaml").workcell
    hole = Pose.from_translation([100.0, 0.0, 0.3])
    pose = hole @ Pose.from_translation([0.0, 0.0, 0.03 - cell.peg.shape().tip_m])
    request = EstimateSeated(
        prior=PosePrior(pose_base_hole=PoseData.of(hole), covariance=floats(np.diag([0.1] * 6))),
        pose_base_peg=PoseData.of(pose), joints_rad=cell.home_joints_rad, wrench=(200.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    with pytest.raises(CommandRefused, match=r"position_m\.0 of the answer would be 100\.\d+") as refusal:
        bus.call(SEATED, request, 30.0)
    assert refusal.value.code == "implausible"
