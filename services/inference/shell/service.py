"""Binds the estimator, the touch policy and the paper's network to their keys."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose, rotation_to_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import ADVISE_INSERTION, ESTIMATE, NETWORK, NEXT_TOUCH, SEATED
from crosspih_common.messages import (
    AdviseInsertion,
    EstimateByNetwork,
    EstimatePose,
    EstimateSeated,
    InsertionAdvice,
    NextTouch,
    PoseData,
    PoseErrorEstimate,
    Severity,
    Touch,
    TouchPlan,
    TouchUse,
    floats,
)
from crosspih_common.messages import PosePrior as PriorMessage
from crosspih_common.service import ServiceContext
from crosspih_common.wrench import refuse_implausible_wrench
from services.inference.config import InferenceConfig
from services.inference.estimator import (
    BoreWalls,
    EstimatorSettings,
    HolePosePrior,
    NotSeated,
    PressSettings,
    TouchObservation,
    TouchVerdict,
    advise_insertion,
    estimate_pose,
    final_estimate,
    pressed_estimate,
)
from services.inference.mechanics import PairTables
from services.inference.network.paper.estimator import NetworkEstimator, NetworkUnavailable
from services.inference.shell.own import OwnEstimator, OwnNetwork
from services.inference.shell.plausible import (
    refuse_implausible_answers,
    refuse_implausible_peg,
    refuse_implausible_prior,
    refuse_implausible_touches,
)
from services.inference.shell.sequence_network import SequenceShell
from services.inference.touch_choice.by_information import candidates, informed_touch
from services.inference.touch_choice.by_rule import next_touch

NARROWED = 0.25  # ratio of a direction's variance to the prior's: half its standard deviation


class InferenceShell:
    """The service on the bus. Every answer depends on its request alone, so a restart loses no state."""

    def __init__(self, context: ServiceContext, config: InferenceConfig) -> None:
        self._config, self._workcell = config, context.cell.workcell
        self._peg = self._workcell.peg.shape()
        self._hole = self._workcell.hole.shape(self._peg)
        self._tables = PairTables.of(self._peg, self._hole)
        # directions that the bore holds: all but the depth, and for a round peg not the turn
        self._held = 5 if BoreWalls.of(self._peg, self._hole).turn_fixed else 4
        contact_n_m = self._workcell.contact_stiffness_n_m
        self._press_settings = PressSettings.of(contact_n_m)
        self._settings = EstimatorSettings(
            gap_sd_m=EstimatorSettings.gap_sd_of(contact_n_m),
            friction_mean=self._workcell.friction_expected,
            friction_sd=config.friction_sd,
            samples=config.samples,
            starts=config.starts,
        )
        self._own_estimator = OwnEstimator(config.estimator, self._workcell) if config.estimator else None
        self._network: NetworkEstimator | OwnNetwork | None = None
        try:
            self._network = (
                OwnNetwork(config.network, self._workcell)
                if config.network
                else NetworkEstimator(config.weights, self._peg, self._hole)
            )
        except NetworkUnavailable as error:
            context.event(Severity.WARNING, "network", str(error))
        context.bus.serve(ESTIMATE, refuse_implausible_answers(self._estimate))
        context.bus.serve(NEXT_TOUCH, refuse_implausible_answers(self._next_touch))
        context.bus.serve(SEATED, refuse_implausible_answers(self._seated))
        context.bus.serve(NETWORK, refuse_implausible_answers(self._by_network))
        SequenceShell(context, config.sequence_weights, self._observation)
        context.bus.serve(ADVISE_INSERTION, refuse_implausible_answers(self._advise))

    def _observation(self, touch: Touch) -> TouchObservation:
        direction = np.asarray(touch.direction_base)
        return TouchObservation(
            pose_base_peg=touch.pose_base_peg.pose(),
            wrench_peg=np.asarray(touch.wrench),
            wrench_sd=np.asarray(touch.wrench_sd),
            compliance_peg=self._compliance(touch),
            motion_direction_base=direction / np.linalg.norm(direction),
        )

    def _compliance(self, touch: Touch) -> Array:
        """The compliance for a touch, with the contact's own; in the bore several contacts press, each with its own
        spring."""
        workcell = self._workcell
        return (workcell.arm_compliance_peg if touch.seated else workcell.compliance_peg)(touch.joints_rad)

    def _prior(self, prior: PriorMessage) -> HolePosePrior:
        return HolePosePrior(
            prior.pose_base_hole.pose(),
            np.asarray(prior.covariance).reshape(6, 6),
            tail_degrees=self._config.prior_tail_degrees,
        )

    def _estimate(self, request: EstimatePose) -> PoseErrorEstimate:
        started = time.perf_counter()
        refuse_implausible_touches(request.prior, request.touches, self._peg.tip_m)
        observations = [self._observation(touch) for touch in request.touches]
        if all(touch.seated for touch in request.touches):
            return self._pressed(request, observations, started)
        if self._own_estimator is not None:
            return self._by_own_estimator(self._own_estimator, request, observations, started)
        found = estimate_pose(
            self._tables,
            self._prior(request.prior),
            observations,
            np.random.default_rng(self._config.seed),
            self._settings,
        )
        at_touch = observations[-1].deflected_pose_base_peg()
        return PoseErrorEstimate(
            pose_base_hole=PoseData.of(found.pose_base_hole),
            covariance=floats(found.covariance),
            **_error_in_peg(at_touch, found.pose_base_hole),
            rank=found.rank,
            residual_cost=_finite(found.residual_cost),
            friction=found.friction_coefficient,
            friction_sd=found.friction_sd,
            method="fused",
            rests_on=tuple(
                _use(touch.index, verdict) for touch, verdict in zip(request.touches, found.touches, strict=True)
            ),
            compute_s=time.perf_counter() - started,
        )

    def _by_own_estimator(
        self, own: OwnEstimator, request: EstimatePose, observations: list[TouchObservation], started: float
    ) -> PoseErrorEstimate:
        found = own(request.prior, request.touches)
        prior = np.asarray(request.prior.covariance).reshape(6, 6)
        ratio = np.linalg.eigvals(np.linalg.solve(prior, np.asarray(found.covariance).reshape(6, 6))).real
        return PoseErrorEstimate(
            pose_base_hole=found.pose_base_hole,
            covariance=found.covariance,
            **_error_in_peg(observations[-1].deflected_pose_base_peg(), found.pose_base_hole.pose()),
            rank=int(np.sum(ratio < NARROWED)),
            residual_cost=0.0,
            friction=self._settings.friction_mean,
            friction_sd=self._settings.friction_sd,
            method=own.name,
            # a user's estimator does not report which touches it used
            rests_on=tuple(
                TouchUse(index=touch.index, used=True, hypothesis="", residual_sigma=0.0) for touch in request.touches
            ),
            compute_s=time.perf_counter() - started,
        )

    def _pressed(
        self, request: EstimatePose, observations: list[TouchObservation], started: float
    ) -> PoseErrorEstimate:
        """Only presses against the bore, with the peg inside: many contacts at once, but all linear."""
        try:
            found = pressed_estimate(
                self._peg, self._hole, self._prior(request.prior), observations, self._press_settings
            )
        except ValueError as error:
            raise CommandRefused("not_seated", str(error)) from None
        return PoseErrorEstimate(
            pose_base_hole=PoseData.of(found.pose_base_hole),
            covariance=floats(found.covariance),
            **_error_in_peg(observations[-1].deflected_pose_base_peg(), found.pose_base_hole),
            rank=self._held if any(found.used) else 0,
            residual_cost=_finite(float(np.mean(found.costs))),
            friction=self._settings.friction_mean,
            friction_sd=self._settings.friction_sd,
            method="pressed",
            rests_on=tuple(
                TouchUse(
                    index=touch.index, used=used, hypothesis="walls of the bore", residual_sigma=float(np.sqrt(cost))
                )
                for touch, used, cost in zip(request.touches, found.used, found.costs, strict=True)
            ),
            compute_s=time.perf_counter() - started,
        )

    def _next_touch(self, request: NextTouch) -> TouchPlan:
        refuse_implausible_prior(request.belief, "belief")
        belief, covariance = request.belief.pose_base_hole.pose(), np.asarray(request.belief.covariance).reshape(6, 6)
        if self._config.next_touch == "information":
            plan, _ = informed_touch(
                self._tables,
                candidates(self._peg, belief, covariance),
                belief,
                covariance,
                self._workcell.compliance_peg(self._workcell.home_joints_rad),
                self._workcell.friction_expected,
                np.random.default_rng(self._config.seed + request.touches_made),
            )
        else:
            plan = next_touch(
                self._peg,
                belief,
                covariance,
                request.failed_pushes,
                request.touches_made,
                last_touch_used=request.last_touch_used,
            )
        return TouchPlan(
            pose_base_peg_start=PoseData.of(plan.pose_base_peg_start),
            direction_base=floats(plan.direction_base),
            idea=plan.idea,
        )

    def _seated(self, request: EstimateSeated) -> PoseErrorEstimate:
        started = time.perf_counter()
        self._refuse_implausible(request.prior, "prior", request.pose_base_peg.pose(), request.wrench)
        pose_base_peg = request.pose_base_peg.pose()
        try:
            pose, covariance = final_estimate(
                self._peg,
                self._hole,
                request.prior.pose_base_hole.pose(),
                np.asarray(request.prior.covariance).reshape(6, 6),
                pose_base_peg,
                np.asarray(request.wrench),
                self._workcell.arm_compliance_peg(request.joints_rad),
            )
        except NotSeated as error:
            raise CommandRefused("not_seated", str(error)) from None
        return PoseErrorEstimate(
            pose_base_hole=PoseData.of(pose),
            covariance=floats(covariance),
            **_error_in_peg(pose_base_peg, pose),
            rank=self._held,
            residual_cost=0.0,
            friction=self._settings.friction_mean,
            friction_sd=self._settings.friction_sd,
            method="seated",
            rests_on=(),
            compute_s=time.perf_counter() - started,
        )

    def _refuse_implausible(self, prior: PriorMessage, name: str, pose_base_peg: Pose, wrench: Sequence[float]) -> None:
        refuse_implausible_prior(prior, name)
        refuse_implausible_peg(pose_base_peg, self._peg.tip_m, prior.pose_base_hole.pose(), "pose_base_peg")
        refuse_implausible_wrench(wrench, "wrench")

    def _advise(self, request: AdviseInsertion) -> InsertionAdvice:
        self._refuse_implausible(request.belief, "belief", request.pose_base_peg.pose(), request.wrench)
        try:
            advice = advise_insertion(
                self._peg,
                self._hole,
                request.belief.pose_base_hole.pose(),
                np.asarray(request.belief.covariance).reshape(6, 6),
                request.pose_base_peg.pose(),
                np.asarray(request.wrench),
                self._workcell.arm_compliance_peg(request.joints_rad),
                self._workcell.friction_expected if request.friction is None else request.friction,
                request.push_force_n,
                request.force_limit_n,
            )
        except NotSeated as error:
            # past the rim along the hole's axis, but across it: impossible for a peg in a bore
            raise CommandRefused("not_seated", str(error)) from None
        return InsertionAdvice(
            contact=advice.contact,
            action=advice.action,
            reason=advice.reason,
            entered_m=advice.entered_m,
            push_force_n=advice.push_force_n,
            needed_force_n=advice.needed_force_n,
            rim_force_n=advice.rim_force_n,
            leading_force_n=advice.leading_force_n,
            back_off_m=advice.back_off_m,
            pose_base_peg=PoseData.of(advice.pose_base_peg),
            pose_base_hole=PoseData.of(advice.pose_base_hole),
            covariance=floats(advice.covariance),
        )

    def _by_network(self, request: EstimateByNetwork) -> PoseErrorEstimate:
        if self._network is None:
            raise CommandRefused("no_weights", "the network has no weights; make some with `crosspih train`")
        started = time.perf_counter()
        touch, believed = request.touch, request.pose_base_hole_believed.pose()
        refuse_implausible_peg(touch.pose_base_peg.pose(), self._peg.tip_m, believed, "touch.pose_base_peg")
        refuse_implausible_wrench(touch.wrench, "touch.wrench")
        observation = self._observation(touch)
        pose_base_peg = observation.deflected_pose_base_peg()
        try:
            found = self._network.pose_peg_hole(observation.wrench_peg, pose_base_peg.inverse() @ believed)
        except NetworkUnavailable as error:
            raise CommandRefused("no_weights", str(error)) from None
        pose_base_hole = pose_base_peg @ found
        # one wrench fixes two numbers; the paper gives no covariance, so the prior's is reported
        half_ranges = self._workcell.hole_prior.half_ranges()
        return PoseErrorEstimate(
            pose_base_hole=PoseData.of(pose_base_hole),
            covariance=floats(np.diag((half_ranges / np.sqrt(3.0)) ** 2)),
            **_error_in_peg(pose_base_peg, pose_base_hole),
            rank=2,
            residual_cost=0.0,
            friction=0.0,
            friction_sd=0.0,
            method=self._network.name if isinstance(self._network, OwnNetwork) else "network",
            rests_on=(TouchUse(index=touch.index, used=True, hypothesis="single contact", residual_sigma=0.0),),
            compute_s=time.perf_counter() - started,
        )

    def close(self) -> None:
        """Nothing to release."""


def _error_in_peg(pose_base_peg: Pose, pose_base_hole: Pose) -> dict[str, tuple[float, ...]]:
    """The hole in the peg frame in the paper's terms: (alpha, beta, gamma) and (x, y, z)."""
    pose_peg_hole = pose_base_peg.inverse() @ pose_base_hole
    return {
        "angles_rad": floats(rotation_to_error_angles(pose_peg_hole.rotation)),
        "translation_m": floats(pose_peg_hole.translation_m),
    }


def _finite(cost: float) -> float:
    """A finite cost for the message: a touch that nothing explains has an infinite one."""
    return float(cost) if np.isfinite(cost) else 1e9


def _use(index: int, verdict: TouchVerdict) -> TouchUse:
    names = [f"{contact.kind}, arm {contact.arm}" for contact in verdict.contacts]
    return TouchUse(
        index=index,
        used=verdict.used,
        hypothesis="; ".join(names) or verdict.reason or "none",
        residual_sigma=float(np.sqrt(max(_finite(verdict.cost), 0.0) / 7.0)),
    )
