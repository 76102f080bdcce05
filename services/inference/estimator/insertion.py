"""A peg that stalls in its bore: which walls press, whether it is jammed or wedged, and what frees it.

The walls' forces follow from the wrench: they are the least nonnegative sum of sliding contacts, with friction against
the insertion, that gives its five lateral parts. While the peg slides in, the push has to overcome their friction;
below that the peg is jammed (the jamming diagram of Whitney 1982, for any number of walls). Two opposite contacts that
lie in each other's friction cone clamp the peg whatever the push does (Nguyen 1988: force closure of two points;
Whitney's wedging). Their clamping force shows in no wrench. It shows only if the push is held by more than the friction
of the felt walls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import adjoint_wrench
from crosspih_common.messages import BoreContact, InsertionAction
from crosspih_common.shapes import Hole, Peg
from services.inference.estimator.bore import PLANE, BoreWalls
from services.inference.estimator.seated import final_estimate


@dataclass(frozen=True, slots=True)
class InsertionSettings:
    """When a wall counts as felt (N), how much of a push its friction may take, and how far to back off (m).

    share: of the push; friction beyond it is assumed to hold the push. hidden_n: the push may exceed the felt walls'
    friction by this before something else must hold the peg. step_m: out of a jam; past_rim_m: out of a wedge, the
    body's end in front of the bore. lowest_push_n: least push that is advised.
    """

    felt_n: float = 0.7
    share: float = 0.85
    hidden_n: float = 2.0
    step_m: float = 0.002
    past_rim_m: float = 0.001
    lowest_push_n: float = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class InsertionJudgement:
    """As the message of the same name: forces N, lengths m, poses in the base frame, covariance (6, 6)."""

    contact: BoreContact
    action: InsertionAction
    reason: str
    entered_m: float
    push_force_n: float
    needed_force_n: float
    rim_force_n: float
    leading_force_n: float
    back_off_m: float
    pose_base_peg: Pose
    pose_base_hole: Pose
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class BoreLoad:
    """The walls' forces (2, J), N: at the rim, at the leading end; and the friction that a slide has to overcome, N."""

    forces_n: Array
    needed_force_n: float


def bore_load(walls: BoreWalls, rim_m: float, leading_m: float, wrench_hole: Array, friction: float) -> BoreLoad:
    """The least wall forces that explain the lateral parts of a wrench (6,) about the hole frame's origin while the
    peg slides in: heights in the hole frame, m; friction coefficient."""
    columns = []
    for height in (rim_m, leading_m):
        n = np.column_stack([walls.normals, np.full(len(walls.normals), -friction)])
        p = np.column_stack([walls.places_m, np.full(len(n), height)])
        columns.append(np.column_stack([n, np.cross(p, n)]))
    basis = np.concatenate(columns)[:, PLANE]
    if not walls.turn_fixed:
        basis[:, 4] = 0.0
    middle = 0.5 * (rim_m + leading_m)
    # about the middle, force and moment are separate; a lever of 10 mm scales them to the same size
    to_middle = np.eye(5)
    to_middle[2, 1], to_middle[3, 0] = middle, -middle
    to_middle[2:] /= 0.01
    # the small extra row selects the least forces among those that explain the wrench
    matrix = np.vstack([(basis @ to_middle.T).T, np.full(len(basis), 1e-2)])
    forces, _ = nnls(matrix, np.append(to_middle @ wrench_hole[PLANE], 0.0))
    return BoreLoad(forces.reshape(2, -1), float(friction * forces.sum()))


def clamps(
    walls: BoreWalls, depth_m: float, friction: float, forces_n: Array | None = None, felt_n: float = 0.0
) -> bool:
    """Whether a contact at the rim and one at the leading end, depth_m apart, lie in each other's friction cones.

    With forces (2, J) only walls that press with at least felt_n are considered.
    """
    rim, leading = np.nonzero(np.ones((len(walls.normals),) * 2))
    if forces_n is not None:
        pressing = (forces_n[0][rim] >= felt_n) & (forces_n[1][leading] >= felt_n)
        rim, leading = rim[pressing], leading[pressing]
    between = np.column_stack([walls.places_m[leading] - walls.places_m[rim], np.full(len(rim), depth_m)])
    between /= np.linalg.norm(between, axis=1)[:, None]
    cosine = 1.0 / np.hypot(1.0, friction)
    from_rim = np.einsum("ki,ki->k", between[:, :2], walls.normals[rim])
    from_leading = -np.einsum("ki,ki->k", between[:, :2], walls.normals[leading])
    return bool(np.any((from_rim >= cosine) & (from_leading >= cosine)))


def advise_insertion(
    peg: Peg,
    hole: Hole,
    pose_base_hole: Pose,
    covariance: Array,
    pose_base_peg: Pose,
    wrench_peg: Array,
    compliance_peg: Array,
    friction: float,
    push_force_n: float,
    force_limit_n: float = 20.0,
    settings: InsertionSettings | None = None,
) -> InsertionJudgement:
    """The state of a stalled peg in its bore, and the advised action.

    pose_base_hole, covariance (6, 6): the belief. pose_base_peg: motor-side pose of the peg; wrench_peg (6,) on the
    peg and compliance_peg (6, 6) give its deflection. push_force_n: the largest axial force of the push.
    Raises NotSeated for a peg that is past the rim along the axis of the hole, but lies across it.
    """
    settings = settings or InsertionSettings()
    walls = BoreWalls.of(peg, hole)
    wrench = np.asarray(wrench_peg, float)
    compliance = np.asarray(compliance_peg, float)
    twist = compliance @ wrench
    pose = pose_base_hole.inverse() @ pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3])
    leading = float(pose.apply([0.0, 0.0, peg.taper_start_m])[2])
    entered = leading - hole.chamfer_m
    to_hole = adjoint_wrench(pose)
    felt = to_hole @ wrench
    held = max(0.0, -float(felt[2]))

    def advice(
        contact: BoreContact, action: InsertionAction, reason: str, push_n: float, load: BoreLoad, back_off_m: float
    ) -> InsertionJudgement:
        if entered > 0.0:
            hole_pose, spread = final_estimate(peg, hole, pose_base_hole, covariance, pose_base_peg, wrench, compliance)
        else:
            hole_pose, spread = pose_base_hole, np.asarray(covariance, float)
        depth = float((hole_pose.inverse() @ pose_base_peg).apply([0.0, 0.0, peg.tip_m])[2])
        aim = hole_pose @ Pose.from_translation([0.0, 0.0, depth - back_off_m - peg.tip_m])
        rim_n, leading_n = load.forces_n.sum(axis=1)
        return InsertionJudgement(
            contact, action, reason, entered, push_n, load.needed_force_n, float(rim_n), float(leading_n), back_off_m,
            aim, hole_pose, spread,
        )  # fmt: skip

    if entered <= 0.0:
        nothing = BoreLoad(np.zeros((2, len(walls.normals))), 0.0)
        reason = f"the body is {-entered * 1e3:.1f} mm short of the bore: touch and estimate"
        clear = settings.past_rim_m + peg.taper_length_m
        return advice(BoreContact.OUTSIDE, InsertionAction.BACK_OFF, reason, push_force_n, nothing, clear)
    load = bore_load(walls, hole.chamfer_m, leading, felt, friction)
    rim_n, leading_n = load.forces_n.sum(axis=1)
    out_of_wedge = entered + settings.past_rim_m
    if held > settings.share * push_force_n and held > 1.25 * load.needed_force_n + settings.hidden_n:
        # the friction of the felt walls is not enough to hold the push
        if clamps(walls, entered, friction):
            reason = f"{held:.1f} N are held by walls that clamp one another {entered * 1e3:.1f} mm inside"
            return advice(
                BoreContact.WEDGED, InsertionAction.BACK_OFF, reason, _lower(push_force_n, settings), load, out_of_wedge
            )
        reason = f"something that is no wall holds {held:.1f} N"
        return advice(BoreContact.JAMMED, InsertionAction.BACK_OFF, reason, push_force_n, load, settings.step_m)
    if clamps(walls, entered, friction, load.forces_n, settings.felt_n):
        reason = f"walls of {rim_n:.1f} and {leading_n:.1f} N lie in one another's friction cones"
        return advice(
            BoreContact.WEDGED, InsertionAction.BACK_OFF, reason, _lower(push_force_n, settings), load, out_of_wedge
        )
    if load.needed_force_n <= settings.share * push_force_n:
        if max(rim_n, leading_n) < settings.felt_n:
            contact = BoreContact.FREE
        elif min(rim_n, leading_n) < settings.felt_n:
            contact = BoreContact.ONE_POINT
        else:
            contact = BoreContact.TWO_POINT
        reason = f"it slides from {load.needed_force_n:.1f} N on"
        return advice(contact, InsertionAction.CONTINUE, reason, push_force_n, load, 0.0)
    # Jammed. The arm bends under the push itself; find the push that best overcomes its friction.
    middle = Pose.from_translation([0.0, 0.0, 0.5 * (hole.chamfer_m + leading)])
    into = adjoint_wrench(middle.inverse() @ pose)
    # twist and wrench transform inversely: C_middle = A^-T C A^-1
    back = np.linalg.inv(into)
    bending = back.T @ compliance @ back
    by_push = np.linalg.solve(bending[np.ix_(PLANE, PLANE)], bending[PLANE, 2])
    from_middle = adjoint_wrench(middle)
    best_n, best_share = push_force_n, np.inf
    for push_n in np.linspace(settings.lowest_push_n, max(force_limit_n, push_force_n, settings.lowest_push_n), 24):
        lateral = np.zeros(6)
        lateral[PLANE] = by_push * (push_n - held)
        changed = felt + from_middle @ lateral
        share = bore_load(walls, hole.chamfer_m, leading, changed, friction).needed_force_n / push_n
        if share < best_share - 1e-9:
            best_n, best_share = float(push_n), share
    if best_share <= settings.share:
        action = InsertionAction.LOWER_PUSH if best_n < push_force_n else InsertionAction.CONTINUE
        reason = f"friction holds {load.needed_force_n:.1f} N now, but not a push of {best_n:.1f} N"
        return advice(BoreContact.JAMMED, action, reason, best_n, load, 0.0)
    reason = f"friction of the walls' {rim_n:.1f} and {leading_n:.1f} N holds any push: the peg is pressed askew"
    return advice(
        BoreContact.JAMMED, InsertionAction.BACK_OFF, reason, push_force_n, load, min(settings.step_m, entered)
    )


def _lower(push_n: float, settings: InsertionSettings) -> float:
    return max(settings.lowest_push_n, 0.5 * push_n)
