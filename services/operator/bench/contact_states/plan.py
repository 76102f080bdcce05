"""The pushes to make: pose errors chosen for each state and each stiffness of the wrist, by seed alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell
from crosspih_common.contacts import ArmEdges
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import skew
from services.operator.bench.contact_states.aiming import AimedPushes, pattern_of, predict_pushes

RANDOM = "random"
AHEAD_M = 0.1
HALF_RANGE_RAD = 0.1
HALF_RANGE_M = 0.005
MIN_YAW_RAD = 0.008
FORCE_N = (8.0, 20.0)
FURTHER = 1.5
BATCH = 4000
MAX_BATCHES = 60


def arms_of(name: str) -> tuple[tuple[int, ...], int]:
    """The arms and the sense of a state named count-sense-case."""
    count, sense, case = (int(part) for part in name.split("-"))
    arms = {1: (case,), 2: (case, case % 4 + 1), 3: tuple({1, 2, 3, 4} - {case}), 4: (1, 2, 3, 4)}[count]
    return tuple(sorted(arms)), sense


STATE_NAMES = tuple(
    f"{count}-{sense}-{case}"
    for count in (1, 2, 3, 4)
    for sense in (1, 2)
    for case in ((1, 2, 3, 4) if count < 4 else (1,))
)
"""The 26 states, as Tables 2-5 name them."""


class Push(BaseModel):
    """One push: the peg's error, the target force, and the travel to first contact that the geometry predicts."""

    model_config = ConfigDict(frozen=True)

    angles_rad: tuple[float, float, float]
    lateral_m: tuple[float, float]
    force_n: float
    travel_m: float


class Plan(BaseModel):
    """Pushes for each state, and `random` ones drawn from the whole range; `share`: how often a random push is
    predicted to produce each state.
    """

    model_config = ConfigDict(frozen=True)

    stiffness_n_mm: float
    seed: int
    pushes: dict[str, tuple[Push, ...]]
    share: dict[str, float]


def joints_at_hole(workcell: Workcell) -> Array:
    """The joints (6,) with the peg halfway into the nominal hole's rim."""
    peg = workcell.peg.shape()
    pose = workcell.hole_prior.pose_base_hole() @ Pose.from_translation([0.0, 0.0, -peg.taper_start_m - 0.01])
    return np.asarray(nearest(workcell.arm(), pose @ workcell.pose_flange_peg().inverse(), workcell.home_joints_rad))


def lateral_stiffness_n_m(workcell: Workcell) -> float:
    """The lateral stiffness with which the arm holds the peg at the rim: the geometric mean of both directions, N/m."""
    compliance = workcell.arm_compliance_peg(joints_at_hole(workcell))
    to_rim = np.eye(6)
    to_rim[:3, 3:] = -skew([0.0, 0.0, 0.5 * (workcell.peg.shape().tip_m + workcell.peg.shape().taper_start_m)])
    lateral = (to_rim @ compliance @ to_rim.T)[:2, :2]
    return float(1.0 / np.sqrt(np.linalg.det(lateral)))


def make_plan(
    workcell: Workcell, friction: float, stiffness_n_mm: float, each: int, random: int, seed: int,
    on_batch: Callable[[int, int], None] = lambda done, wanted: None,
) -> Plan:  # fmt: skip
    """`each` pushes for each state and `random` ones. workcell: with the joint stiffness of this plan.

    Draws are shrunk towards the centred peg by a factor drawn log-uniformly, because several arms touch only near it.
    Contacts of three arms, the rarest, are also drawn near earlier ones, turned to the state that is missing.
    """
    rng = np.random.default_rng([seed, round(stiffness_n_mm)])
    peg = workcell.peg.shape()
    edges = ArmEdges.of(peg, workcell.hole.shape(peg))
    compliance = workcell.compliance_peg(joints_at_hole(workcell))

    def pushed(angles: Array, lateral: Array, force: Array) -> AimedPushes:
        return predict_pushes(edges, compliance, friction, angles, lateral, force, AHEAD_M)

    wanted = {pattern_of(*arms_of(name)): name for name in STATE_NAMES}
    found: dict[str, list[Push]] = {name: [] for name in STATE_NAMES}
    share = dict.fromkeys((*STATE_NAMES, "none"), 0.0)
    for batch in range(MAX_BATCHES):
        # the first batch is the random one, and shows how often each state comes by itself
        scale = np.exp(rng.uniform(np.log(0.003), 0.0, (BATCH, 1))) if batch else np.ones((BATCH, 1))
        angles = rng.uniform(-HALF_RANGE_RAD, HALF_RANGE_RAD, (BATCH, 3))
        lateral = rng.uniform(-HALF_RANGE_M, HALF_RANGE_M, (BATCH, 2)) * scale
        angles[:, 1:] *= scale
        if batch:
            yaw = angles[:, 0]
            angles[:, 0] = np.sign(yaw) * (MIN_YAW_RAD + np.abs(yaw) * (1.0 - MIN_YAW_RAD / HALF_RANGE_RAD))
            threes = [name for name in STATE_NAMES if name[0] == "3" and len(found[name]) < each]
            known = [(push, name) for name in STATE_NAMES if name[0] == "3" for push in found[name]]
            if threes and known and batch % 2 == 0:
                near = [
                    _turned(known[index][0], known[index][1], threes[wish])
                    for index, wish in zip(
                        rng.integers(0, len(known), BATCH), rng.integers(0, len(threes), BATCH), strict=True
                    )
                ]
                drawn = np.array(near) * (1.0 + rng.normal(0.0, 0.1, (BATCH, 5)))
                angles, lateral = drawn[:, :3], drawn[:, 3:]
        aimed = pushed(angles, lateral, rng.uniform(*FORCE_N, BATCH))
        patterns = aimed.pattern()
        if batch == 0:
            for bits in patterns.tolist():
                share[wanted.get(bits, "none")] += 1.0 / BATCH
            continue
        short = [bits for bits, name in wanted.items() if len(found[name]) < each]
        rows = np.flatnonzero(np.isin(patterns, short))
        # some force is added while the push is observed: the state must persist
        further = pushed(angles[rows], lateral[rows], FURTHER * aimed.wanted_n[rows]).pattern()
        for index in rows[further == patterns[rows]].tolist():
            name = wanted[int(patterns[index])]
            if len(found[name]) < each:
                found[name].append(_push(aimed, index))
        left = min(len(rows) for rows in found.values())
        on_batch(left, each)
        if left >= each:
            break
    any_angles = rng.uniform(-HALF_RANGE_RAD, HALF_RANGE_RAD, (random, 3))
    any_lateral = rng.uniform(-HALF_RANGE_M, HALF_RANGE_M, (random, 2))
    at_random = pushed(any_angles, any_lateral, rng.uniform(*FORCE_N, random))
    pushes = {name: tuple(rows) for name, rows in found.items()}
    pushes[RANDOM] = tuple(_push(at_random, index) for index in range(random))
    return Plan(stiffness_n_mm=stiffness_n_mm, seed=seed, pushes=pushes, share=share)


def _turned(push: Push, name: str, wished: str) -> list[float]:
    """The errors (alpha, beta, gamma, x, y) of a push mirrored and rotated by quarter turns from one state to another.

    Exact for small angles and an arm of equal stiffness in all directions: good enough to search near it.
    """
    alpha, beta, gamma = push.angles_rad
    x, y = push.lateral_m
    arm, sense, case = int(name[4]), name[2], int(wished[4])
    if sense != wished[2]:
        alpha, gamma, y = -alpha, -gamma, -y
        arm = (1, 4, 3, 2)[arm - 1]
    for _ in range((case - arm) % 4):
        beta, gamma, x, y = gamma, -beta, -y, x
    return [alpha, beta, gamma, x, y]


def _push(aimed: AimedPushes, index: int) -> Push:
    alpha, beta, gamma = aimed.angles_rad[index].tolist()
    x, y = aimed.lateral_m[index].tolist()
    travel = float(aimed.travel_m[index])
    return Push(
        angles_rad=(alpha, beta, gamma),
        lateral_m=(x, y),
        force_n=float(aimed.wanted_n[index]),
        travel_m=travel if np.isfinite(travel) else 0.0,
    )


def arms_aimed_at(plan: Plan) -> list[float]:
    """How often a random push touches with 1, 2, 3 and 4 arms by the geometry, and in none of the 26 states."""
    counts = [sum(share for name, share in plan.share.items() if name[0] == count) for count in "1234"]
    return [*counts, plan.share.get("none", 0.0)]


def load_or_make(path: Path, make: Callable[[], Plan]) -> Plan:
    """The plan from a file, or a new one that is then saved there."""
    if path.exists():
        return Plan.model_validate(json.loads(path.read_text(encoding="utf-8")))
    plan = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(plan.model_dump_json(), encoding="utf-8")
    return plan
