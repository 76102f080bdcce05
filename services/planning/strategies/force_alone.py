"""No vision: feel for the face and for the hole in it, then touch, estimate and push as ever."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import ESTIMATE, NEXT_TOUCH
from crosspih_common.messages import (
    EstimatePose,
    Failure,
    NextTouch,
    Phase,
    PoseData,
    PosePrior,
    StopReason,
    Touch,
    floats,
)
from services.planning.leaving import withdraw
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.search import FaceContact, FacePlane, HoleBelief, face_contact
from services.planning.search.belief import pose_prior
from services.planning.strategies.advised_push import push_in
from services.planning.strategies.correcting import correct, report_estimate
from services.planning.touching import deflected, touch_from

IN_HOLE_M = 1.5e-3  # a tip this far behind the face, and three sd of the face, is in the hole
REACH_SD = 2.5
BACK_M_S = 0.06


def force_alone(run: Run) -> PosePrior:
    """Probe where the hole can be until the tip goes past the face; then fuse touches and push.

    What is known beforehand is the cell's own prior, nothing else.
    """
    search = Search(run)
    half = search.half_ranges
    search.run.motion.approach(search.nominal, search.clear_m(0.0, 0.0))
    run.tell(
        Phase.TOUCHING,
        "feeling for the hole",
        half_range_lateral_mm=float(half[0]) * 1e3,
        half_range_depth_mm=float(half[2]) * 1e3,
    )
    while search.probes < run.config.max_probes:
        if search.probe():
            belief = search.enter()
            if belief is not None:
                return belief
    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{search.probes} probes and {run.counts.pushes} pushes did not enter")


class Search:
    """What has been felt so far, in the nominal hole's frame."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.half_ranges = run.workcell.hole_prior.half_ranges()
        self.nominal = run.workcell.hole_prior.pose_base_hole()
        self.peg = run.workcell.peg.shape()
        self.hole = run.workcell.hole.shape(self.peg)
        self.tip_m = self.peg.outline_m(self.peg.tip_m)
        self.in_hole: list[Touch] = []
        self.probes = self.failed_pushes = 0
        self.forget()

    def forget(self) -> None:
        """Know no more than the cell's prior."""
        self.plane = FacePlane.from_half_ranges(self.half_ranges)
        self.belief = HoleBelief.uniform(self.hole.outer_rim_m(), self.tip_m, self.half_ranges)
        self.contacts: list[FaceContact] = []

    def clear_m(self, x_m: float, y_m: float) -> float:
        """How far before the face, as believed at a place, the tip is surely free."""
        centre = self.plane.pose(x_m, y_m).translation_m
        _, sd_m = self.plane.depth_m(centre)
        tip_m = float(np.linalg.norm(self.tip_m[:, :2], axis=1).max())
        most = float(self.half_ranges[2]) + float(self.half_ranges[3]) * (float(np.hypot(x_m, y_m)) + tip_m)
        return self.run.config.standoff_m + min(REACH_SD * sd_m, most)

    # ----------------------------------------------------------------------------------------------------- searching

    def probe(self) -> bool:
        """Push straight at the likeliest place; whether the tip went past the face."""
        run = self.run
        (x, y), turn, chance = self.belief.best_probe()
        clear_m = self.clear_m(float(x), float(y))
        start = self.nominal @ self.plane.pose(float(x), float(y), turn)
        start = start @ Pose.from_translation([0.0, 0.0, -self.peg.tip_m - clear_m])
        self.probes += 1
        run.tell(
            Phase.TOUCHING,
            f"probe {self.probes} at ({x * 1e3:.1f}, {y * 1e3:.1f}) mm",
            chance=chance,
            turn_deg=float(np.rad2deg(turn)),
        )
        touch = self.feel(start, start.rotation[:, 2], clear_m)
        if touch is None:
            run.motion.slide_to(start, BACK_M_S)
            return run.last_stop is StopReason.TRAVEL_LIMIT
        return self.take(touch, start)

    def feel(self, start: Pose, direction: Array, clear_m: float) -> Touch | None:
        """Touch from `clear_m` before the face as believed: slowly until the tip is as far behind it."""
        slow_m = 2.0 * clear_m
        return touch_from(
            self.run,
            start,
            direction,
            self.run.config.touch_speed_m_s,
            self.run.config.touch_threshold_n,
            slow_m + self.peg.taper_length_m + self.hole.chamfer_m,
            slow_m,
        )

    def take(self, touch: Touch, start: Pose) -> bool:
        """Learn from a touch and go back to where it started; whether it was in the hole."""
        run = self.run
        pose_nominal_peg = self.nominal.inverse() @ deflected(run, touch)
        contact = face_contact(self.tip_m, pose_nominal_peg, np.asarray(touch.wrench))
        if contact is not None and self.contacts:
            behind_m, sd_m = self.plane.depth_m(contact.point_m)
            if behind_m > IN_HOLE_M + 3.0 * sd_m:
                contact = None
            elif behind_m < -IN_HOLE_M - 3.0 * sd_m:
                # nothing stands before the face: what was taken for it lay deeper, in the hole
                self.forget()
        run.motion.slide_to(start, BACK_M_S)
        if contact is not None:
            self.contacts.append(contact)
            self.plane = self.plane.with_point(contact.point_m)
            self.belief = self.belief.after_face(contact)
            run.tell(
                Phase.TOUCHING,
                "the face" if contact.at_corner else "the rim, from outside",
                depth_mm=float(contact.point_m[2]) * 1e3,
            )
            return False
        self.in_hole.append(touch)
        self.belief = self.belief.after_entry(pose_nominal_peg.apply(self.tip_m)[:, :2])
        run.tell(Phase.TOUCHING, "past the face: in the hole")
        return True

    # ------------------------------------------------------------------------------------------------------ entering

    def prior(self) -> PosePrior:
        """What face and probes leave, for the estimator."""
        pose, covariance = pose_prior(self.belief, self.plane)
        return PosePrior(pose_base_hole=PoseData.of(self.nominal @ pose), covariance=floats(covariance))

    def enter(self) -> PosePrior | None:
        """Touch, estimate, correct and push until the peg is in; None when the tip misses the hole again."""
        run, config = self.run, self.run.config
        explained = True
        touches = 0
        residual = 0.0
        prior = self.prior()
        belief = prior
        for _ in range(config.max_attempts * config.touches_a_push):
            run.counts.attempt = self.failed_pushes
            if self.in_hole:
                estimate = run.ports.ask(ESTIMATE, EstimatePose(prior=prior, touches=tuple(self.in_hole)))
                report_estimate(run, estimate)
                explained = estimate.rests_on[-1].used
                residual = estimate.residual_cost
                if any(use.used for use in estimate.rests_on) and run.hole.is_plausible_hole_pose(
                    estimate.pose_base_hole.pose()
                ):
                    belief = PosePrior(pose_base_hole=estimate.pose_base_hole, covariance=estimate.covariance)
            touches += 1
            if (self.is_narrow(belief) and residual < config.narrow_residual) or touches > config.touches_a_push:
                pose = belief.pose_base_hole.pose()
                correct(run, pose)
                seated = push_in(run, belief)
                if seated is not None:
                    return seated
                withdraw(run, pose, config.standoff_m)
                self.failed_pushes += 1
                touches = 0
                if self.failed_pushes >= config.max_attempts:
                    raise AssemblyFailed(Failure.NOT_CONVERGED, f"{run.counts.pushes} pushes did not enter")
            plan = run.ports.ask(
                NEXT_TOUCH,
                NextTouch(
                    belief=belief,
                    touches_made=len(self.in_hole),
                    failed_pushes=self.failed_pushes,
                    last_touch_used=explained,
                ),
            )
            start = plan.pose_base_peg_start.pose()
            tip = belief.pose_base_hole.pose().inverse().apply(start.apply([0.0, 0.0, self.peg.tip_m]))
            touch = self.feel(start, np.asarray(plan.direction_base), max(float(-tip[2]), config.standoff_m))
            if touch is None:
                run.motion.slide_to(start, BACK_M_S)
                touches = config.touches_a_push
            elif not self.take(touch, start):
                return None
        return None

    def is_narrow(self, belief: PosePrior) -> bool:
        """Whether a push can be expected to go in."""
        sd = np.sqrt(np.diag(np.asarray(belief.covariance).reshape(6, 6)))
        # a round peg goes in at any turn, and nothing ever tells which
        turns = sd[3:] if self.peg.outline.symmetry_order else sd[3:5]
        config = self.run.config
        return bool(sd[:2].max() < config.narrow_lateral_m and turns.max() < config.narrow_rotation_rad)
