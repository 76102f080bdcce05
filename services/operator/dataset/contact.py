"""One contact in the simulated cell: a random pose error, a push, the compensated wrench."""

from __future__ import annotations

from typing import Any

import numpy as np

from crosspih_common.datasets import CONTACT, ContactRow
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.holding import ArmLease
from crosspih_common.keys import COMPENSATE, GUARDED_MOVE
from crosspih_common.messages import CompensateWrench, GuardedMove, PoseData, ResetCell, floats
from services.operator.assembly.payload import ready_arm
from services.operator.assembly.session import Session

STANDOFF_M = 0.004
TRAVEL_LIMIT_M = 0.045
PUSH_SPEED_M_S = 0.01
# the seeds of a pose's repeats are this far apart
REPEAT_STRIDE = 1_000_000


def draw_pose_peg_hole(rng: np.random.Generator, angle_rad: float, lateral_m: float) -> tuple[Array, Array]:
    """Error angles (alpha, beta, gamma), uniform, and lateral offset (x, y) at the rim, uniform."""
    return rng.uniform(-angle_rad, angle_rad, 3), rng.uniform(-lateral_m, lateral_m, 2)


def start_pose_hole_peg(angles_rad: Array, lateral_m: Array, tip_m: float) -> Pose:
    """The peg before the hole with a given error: its tip at the standoff, its axis through the offset at the rim."""
    rotation_hole_peg = rotation_from_error_angles(angles_rad).T
    # the axis meets the face's plane at the offset; the tip stays short of it
    tip = np.array([*lateral_m, 0.0]) - rotation_hole_peg[:, 2] * (STANDOFF_M / rotation_hole_peg[2, 2])
    return Pose(rotation_hole_peg, tip - rotation_hole_peg[:, 2] * tip_m)


def make_contact(
    session: Session,
    lease: ArmLease,
    pose_seed: int,
    repeat: int,
    angle_rad: float,
    lateral_m: float,
    threshold_n: float,
) -> ContactRow:
    """One contact: a random error, a guarded push along the peg's own axis, the compensated wrench.

    A push that meets nothing, or that the cell refuses, becomes a row that says so.
    """
    angles, lateral = draw_pose_peg_hole(np.random.default_rng(pose_seed), angle_rad, lateral_m)
    seed = pose_seed + repeat * REPEAT_STRIDE

    def nothing(why: str) -> ContactRow:
        return ContactRow(seed=seed, pose_seed=pose_seed, repeat=repeat, outcome=why, angles_rad=floats(angles))

    pose_hole_peg = start_pose_hole_peg(angles, lateral, session.cell.workcell.peg.shape().tip_m)
    try:
        truth = session.new_trial(ResetCell(seed=seed, offset_hole=(0.0,) * 6, place_peg=PoseData.of(pose_hole_peg)))
        pose_base_peg = truth.pose_base_hole.pose() @ pose_hole_peg
        outcome = lease.ask(
            GUARDED_MOVE,
            GuardedMove(
                direction_base=floats(pose_base_peg.rotation[:, 2]),
                speed_m_s=PUSH_SPEED_M_S,
                force_threshold_n=threshold_n,
                travel_limit_m=TRAVEL_LIMIT_M,
            ),
            60.0,
        )
        if outcome.wrench_observed_raw is None or outcome.pose_base_peg_observed is None:
            return nothing(f"felt nothing ({outcome.stop_reason.value})")
        reading = session.bus.call(
            COMPENSATE,
            CompensateWrench(
                pose_base_peg=outcome.pose_base_peg_observed,
                wrench_raw=outcome.wrench_observed_raw,
                wrench_sd=outcome.wrench_observed_sd or (0.02,) * 6,
            ),
            10.0,
        )
    except CommandRefused as error:
        return nothing(str(error))
    observed = outcome.pose_base_peg_observed.pose()
    pose_peg_hole = observed.inverse() @ truth.pose_base_hole.pose()
    return ContactRow(
        seed=seed,
        pose_seed=pose_seed,
        repeat=repeat,
        outcome=CONTACT,
        angles_rad=floats(angles),
        translation_m=floats(pose_peg_hole.translation_m),
        wrench=reading.wrench,
        wrench_sd=reading.wrench_sd,
        state=reading.state.case,
        state_confidence=reading.state.confidence,
        n_z0=reading.state.n_z0,
        direction_peg=floats(observed.rotation.T @ np.asarray(outcome.direction_base)),
        travel_m=outcome.travel_first_contact_m,
    )


def make_contacts(session: Session, payload: dict[str, Any]) -> list[dict[str, Any]]:
    """A worker's task: `samples` [(pose_seed, repeat), ...] with angle_rad, lateral_m and threshold_n; rows as plain
    data."""
    with ready_arm(session, "contacts for a data set") as lease:
        return [
            make_contact(
                session, lease, pose_seed, repeat, payload["angle_rad"], payload["lateral_m"], payload["threshold_n"]
            ).model_dump()
            for pose_seed, repeat in payload["samples"]
        ]
