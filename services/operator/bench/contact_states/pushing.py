"""One push made in the cell over the bus, with the measured wrench and the true contacts."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from pydantic import BaseModel, ConfigDict

from crosspih_common.bus.bus import Latest
from crosspih_common.errors import CommandRefused, NoService
from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.holding import ArmLease
from crosspih_common.keys import COMPENSATE, GUARDED_MOVE, TRUTH
from crosspih_common.messages import (
    CompensateWrench,
    GuardedMove,
    PoseData,
    ResetCell,
    SimulationTruth,
    floats,
)
from services.operator.assembly.payload import ready_arm
from services.operator.assembly.session import Session
from services.operator.bench.contact_states.aiming import start_translation_m
from services.operator.bench.contact_states.plan import AHEAD_M, Push

NEEDED = ("hardware", "force_torque", "planning")
# placed this much before the predicted first contact, then further back when that overlaps
SHORT_M = (0.0008, 0.003, 0.012)
SPEED_M_S = 0.006
# Four arms wedged in a stiff wrist resist with 500 N/mm: a creep of 1 mm/s would double the force while it is observed.
CREEP_M_S = 0.0002
TRAVEL_LIMIT_M = 0.03
MOMENT_NM = 2.5
OBSERVE_S = 0.12
AVERAGE_S = 0.04
WINDOW_NS = 45_000_000
_LISTENING: WeakKeyDictionary[Session, Latest[SimulationTruth]] = WeakKeyDictionary()


class PushTask(BaseModel):
    """One push by name: the intended state, its number there, the seed of sensor noise, and the push."""

    model_config = ConfigDict(frozen=True)

    target: str
    index: int
    seed: int
    push: Push


class PushResult(BaseModel):
    """The result of a push: the compensated wrench with its sd, and the true contact points and forces in the peg frame
    (x, y, z, Fx, Fy, Fz each, m and N, averaged over the observation); or `failure`. `code` is the version that pushed.
    """

    model_config = ConfigDict(frozen=True)

    target: str
    index: int
    stop: str = ""
    wrench: tuple[float, ...] = ()
    wrench_sd: tuple[float, ...] = ()
    contacts: tuple[tuple[float, ...], ...] = ()
    angles_rad: tuple[float, ...] = ()
    lateral_m: tuple[float, ...] = ()
    failure: str | None = None
    code: str = ""


def make_pushes(session: Session, tasks: tuple[PushTask, ...]) -> list[dict[str, Any]]:
    """Each push in turn; one that the cell refuses is a failure of that push."""
    with ready_arm(session, "pushes for contact states") as lease:
        return [make_push(session, lease, task).model_dump(mode="json") for task in tasks]


def _truths(session: Session) -> Latest[SimulationTruth]:
    """The latest truths of a session, one subscription for all its pushes."""
    if session not in _LISTENING:
        _LISTENING[session] = session.bus.latest(TRUTH, depth=8)
    return _LISTENING[session]


def start_pose_hole_peg(push: Push, short_m: float) -> Pose:
    """The peg in the hole frame, `short_m` before first contact along its own axis."""
    rotation = rotation_from_error_angles(np.asarray(push.angles_rad)).T
    start = start_translation_m(rotation, np.asarray(push.lateral_m), AHEAD_M)
    return Pose(rotation, start + rotation[:, 2] * max(push.travel_m - short_m, 0.0))


def _placed(session: Session, task: PushTask) -> SimulationTruth:
    """Place the peg before the hole, as near as it can be. Raises CommandRefused."""
    for short_m in SHORT_M:
        place = PoseData.of(start_pose_hole_peg(task.push, short_m))
        try:
            return session.new_trial(ResetCell(seed=task.seed, offset_hole=(0.0,) * 6, place_peg=place))
        except CommandRefused as error:
            if error.code != "peg_in_contact" or short_m == SHORT_M[-1]:
                raise
    raise AssertionError("unreachable")


def make_push(session: Session, lease: ArmLease, task: PushTask) -> PushResult:
    """Place the peg, push it along its axis until the force is reached, read sensor and truth while it still creeps."""
    about: dict[str, Any] = {"target": task.target, "index": task.index}
    truths = _truths(session)
    try:
        placed = _placed(session, task)
        direction = placed.pose_base_peg.pose().rotation[:, 2]
        outcome = lease.ask(
            GUARDED_MOVE,
            GuardedMove(
                direction_base=floats(direction),
                speed_m_s=SPEED_M_S,
                creep_speed_m_s=CREEP_M_S,
                force_threshold_n=task.push.force_n,
                moment_threshold_nm=MOMENT_NM,
                travel_limit_m=TRAVEL_LIMIT_M,
                observe_s=OBSERVE_S,
                average_s=AVERAGE_S,
            ),
            60.0,
        )
        if outcome.wrench_observed_raw is None or outcome.pose_base_peg_observed is None:
            return PushResult(**about, stop=outcome.stop_reason.value, failure="felt nothing")
        reading = session.bus.call(
            COMPENSATE,
            CompensateWrench(
                pose_base_peg=outcome.pose_base_peg_observed,
                wrench_raw=outcome.wrench_observed_raw,
                wrench_sd=outcome.wrench_observed_sd or (0.02,) * 6,
                wrench_free_raw=outcome.wrench_free_raw,
                pose_base_peg_free=placed.pose_base_peg,
            ),
            10.0,
        )
    except CommandRefused as error:
        return PushResult(**about, failure=str(error))
    truths.wait_for(lambda truth: truth.stamp_ns >= outcome.stamp_ns, 2.0)
    during = [truth for truth in truths.values() if 0 <= outcome.stamp_ns - truth.stamp_ns < WINDOW_NS]
    if not during:
        raise NoService("hardware: no truth of the moment of observing was heard")
    return PushResult(
        **about,
        stop=outcome.stop_reason.value,
        wrench=reading.wrench,
        wrench_sd=reading.wrench_sd,
        contacts=tuple(tuple(row) for row in np.round(contacts_peg(during), 7).tolist()),
        angles_rad=task.push.angles_rad,
        lateral_m=task.push.lateral_m,
    )


def contacts_peg(truths: list[SimulationTruth]) -> Array:
    """(n, 6): points and forces in the peg frame of all contacts of some truths, the forces divided by their number."""
    rows = []
    for truth in truths:
        into_peg = truth.pose_base_peg.pose().inverse()
        for contact in truth.contacts:
            rows.append(
                np.concatenate(
                    [into_peg.apply(contact.point_base_m), into_peg.rotate(contact.force_base_n) / len(truths)]
                )
            )
    return np.reshape(rows, (-1, 6))
