"""`python -m services.inference.rate`: CPU time of each answer of the inference service, beside its core part alone.

An estimate after one, two and three touches and the choice of the most informative touch, each beside its first-contact
queries repeated alone, which is the cost of the contact mechanics. A client's command (encoded, over an in-memory bus,
checked, answered) beside the estimate alone. The trained network's answer beside one forward pass of its layers, where
torch is installed. The two are run alternately and timed by this process's CPU time; one JSON object on
standard output, which `crosspih bench inference` shows.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any
from unittest import mock

import numpy as np

from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.config import CellFile, load_cell
from crosspih_common.config.workcell import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.keys import ESTIMATE
from crosspih_common.messages import ContactState, EstimatePose, PoseData, PosePrior, Touch, floats
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.service.lifecycle import ServiceContext
from services.inference.config import InferenceConfig
from services.inference.estimator import EstimatorSettings, TouchObservation, estimate_pose
from services.inference.estimator import HolePosePrior as Prior
from services.inference.estimator import estimate as estimating
from services.inference.estimator import hypotheses as choosing
from services.inference.estimator.synthetic import touch
from services.inference.mechanics import PairTables, first_contacts
from services.inference.network.paper.estimator import NetworkEstimator
from services.inference.network.settings import PAPER_WEIGHTS
from services.inference.shell.service import InferenceShell
from services.inference.touch_choice import by_information as informed
from services.inference.touch_choice.by_rule import next_touch

PRIOR_SD = (1e-3, 1e-3, 2e-3, 0.04, 0.04, 0.01)  # x, y, z (m), rx, ry, rz (rad): vision at its worst
TOUCHES = 3
ASKING_S = 60.0
Work = Callable[[], object]


def made_touches(
    tables: PairTables, workcell: Workcell, prior: Prior, count: int, seed: int
) -> tuple[TouchObservation, ...]:
    """Simulated touches of a hole drawn from the prior, each planned from the estimate so far."""
    rng = np.random.default_rng(seed)
    error = rng.normal(size=6) * np.asarray(PRIOR_SD)
    hole = prior.pose_base_hole @ Pose.from_rotvec(error[3:], error[:3]).inverse()
    compliance = workcell.compliance_peg(np.asarray(workcell.home_joints_rad))
    peg, tried = workcell.peg.shape(), 0
    made: list[TouchObservation] = []
    belief, covariance = prior.pose_base_hole, prior.covariance
    while len(made) < count:
        plan = next_touch(peg, belief, covariance, tried, tried)
        tried += 1
        start, along = plan.pose_base_peg_start, plan.direction_base
        felt = touch(tables, hole, start, along, compliance, workcell.friction_expected, rng)
        if felt is not None:
            made.append(felt.observation)
            found = estimate_pose(tables, prior, made, np.random.default_rng(seed))
            belief, covariance = found.pose_base_hole, found.covariance
    return tuple(made)


def as_message(index: int, observation: TouchObservation, workcell: Workcell) -> Touch:
    """A touch in the form that planning sends."""
    return Touch(
        index=index,
        pose_base_peg=PoseData.of(observation.pose_base_peg),
        direction_base=floats(observation.motion_direction_base),
        joints_rad=workcell.home_joints_rad,
        wrench=floats(observation.wrench_peg),
        wrench_sd=floats(observation.wrench_sd),
        state=ContactState(case=None, n_z0=0.0, confidence=0.0),
    )


def queries_of(work: Work) -> list[tuple[Any, ...]]:
    """The arguments of each first-contact query in some work."""
    asked: list[tuple[Any, ...]] = []

    def noted(*arguments: Any) -> Any:
        asked.append(arguments)
        return first_contacts(*arguments)

    with ExitStack() as stack:
        for module in (choosing, estimating, informed):
            stack.enter_context(mock.patch.object(module, "first_contacts", noted))
        work()
    return asked


def repeated_queries(queries: list[tuple[Any, ...]]) -> Work:
    """A function that repeats the same queries alone."""

    def ask() -> None:
        for arguments in queries:
            first_contacts(*arguments)

    return ask


def in_turn(ours: Work, bare: Work, rounds: int, times: int = 1) -> dict[str, float]:
    """CPU time, s, per call of each: the minimum over the rounds, each of `times` calls."""
    least = {"ours_s": float("inf"), "bare_s": float("inf")}
    for _ in range(rounds):
        for name, work in (("ours_s", ours), ("bare_s", bare)):
            began_s = time.process_time()
            for _ in range(times):
                work()
            least[name] = min(least[name], (time.process_time() - began_s) / times)
    return least


def measured(rounds: int, seed: int, most_touches: int = TOUCHES) -> dict[str, dict[str, Any]]:
    """By question: CPU time of the answer and of its core part, s, and the name of that part."""
    file = load_cell(DEFAULT_CELL)
    workcell = file.workcell
    peg = workcell.peg.shape()
    hole = workcell.hole.shape(peg)
    tables = PairTables.of(peg, hole)
    prior = Prior(workcell.hole_prior.pose_base_hole(), np.diag(np.square(PRIOR_SD)))
    touches = made_touches(tables, workcell, prior, most_touches, seed)
    config = InferenceConfig()
    settings = EstimatorSettings(
        gap_sd_m=EstimatorSettings.gap_sd_of(workcell.contact_stiffness_n_m),
        friction_mean=workcell.friction_expected,
        friction_sd=config.friction_sd,
        samples=config.samples,
        starts=config.starts,
    )
    rows: dict[str, dict[str, Any]] = {}

    def estimated(count: int) -> Work:
        return lambda: estimate_pose(tables, prior, touches[:count], np.random.default_rng(config.seed), settings)

    for count in range(1, most_touches + 1):
        work = estimated(count)
        queries = queries_of(work)
        poses = sum(int(np.prod(arguments[2].shape[:-1])) for arguments in queries)
        rows[f"estimate of {count} {'touch' if count == 1 else 'touches'}"] = {
            **in_turn(work, repeated_queries(queries), rounds),
            "beside": f"its {poses} first contacts",
        }

    def chosen() -> object:
        plans = informed.candidates(peg, prior.pose_base_hole, prior.covariance)
        compliance = workcell.compliance_peg(np.asarray(workcell.home_joints_rad))
        return informed.informed_touch(
            tables, plans, prior.pose_base_hole, prior.covariance, compliance, workcell.friction_expected,
            np.random.default_rng(config.seed),
        )  # fmt: skip

    queries = queries_of(chosen)
    poses = sum(int(np.prod(arguments[2].shape[:-1])) for arguments in queries)
    rows["most informative touch"] = {
        **in_turn(chosen, repeated_queries(queries), rounds),
        "beside": f"its {poses} first contacts",
    }
    rows["estimate of 1 touch, as a command"] = {
        **commanded(file, prior, touches[:1], estimated(1), rounds),
        "beside": "the estimate alone",
    }
    if importlib.util.find_spec("torch") is not None:
        rows["network"] = {
            **by_network(touches[0], prior, workcell, rounds),
            "beside": "a forward pass of its layers",
        }
    return rows


def commanded(
    file: CellFile, prior: Prior, touches: tuple[TouchObservation, ...], bare: Work, rounds: int
) -> dict[str, float]:
    """A client's command beside the estimate in it: the overhead of the service."""
    hub, workcell = MemoryHub(), file.workcell
    service, client = (
        ServiceContext(name, file, Bus(hub.transport(), workcell.name, name)) for name in ("inference", "operator")
    )
    shell = InferenceShell(service, InferenceConfig())
    request = EstimatePose(
        prior=PosePrior(pose_base_hole=PoseData.of(prior.pose_base_hole), covariance=floats(prior.covariance)),
        touches=tuple(as_message(index, each, workcell) for index, each in enumerate(touches)),
    )
    try:
        return in_turn(lambda: client.bus.call(ESTIMATE, request, ASKING_S), bare, rounds)
    finally:
        shell.close()
        client.bus.close()
        service.bus.close()


def by_network(touch: TouchObservation, prior: Prior, workcell: Workcell, rounds: int) -> dict[str, float]:
    """The paper's step, a wrench to angles and these to x, y, z (Eq. 24), beside the layers alone."""
    import torch

    from services.inference.network.paper.model import AngleNetwork

    peg = workcell.peg.shape()
    whole = NetworkEstimator("", peg, workcell.hole.shape(peg))
    believed = touch.pose_base_peg.inverse() @ prior.pose_base_hole
    network, wrench = AngleNetwork.load(PAPER_WEIGHTS), torch.from_numpy(np.asarray(touch.wrench_peg, float))
    torch.set_num_threads(1)

    def forward() -> None:
        with torch.no_grad():
            network.layers(wrench)

    whole.pose_peg_hole(touch.wrench_peg, believed)  # loads torch and the file
    return in_turn(lambda: whole.pose_peg_hole(touch.wrench_peg, believed), forward, rounds)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1, help="of the touches")
    arguments = parser.parse_args()
    print(json.dumps(measured(arguments.rounds, arguments.seed)))


if __name__ == "__main__":
    main()
