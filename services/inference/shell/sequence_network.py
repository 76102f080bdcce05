"""The sequence network on the bus."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from crosspih_common.config.workcell import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import rotation_to_error_angles
from crosspih_common.keys import SEQUENCE_NETWORK
from crosspih_common.messages import (
    EstimateBySequence,
    PoseData,
    PoseErrorEstimate,
    Severity,
    Touch,
    TouchUse,
    floats,
)
from crosspih_common.modules import ALL_PACKAGES
from crosspih_common.service import ServiceContext
from services.inference.estimator import TouchObservation
from services.inference.network.settings import SEQUENCE_WEIGHTS
from services.inference.shell.plausible import refuse_implausible_answers, refuse_implausible_touches

# below this share of the prior's variance a direction counts as narrowed, as in the estimator
NARROWED = 0.25


class SequenceShell:
    """Answers SEQUENCE_NETWORK. Torch is loaded at the first request, so only users of the network wait for it.

    `observation` converts a touch to the estimator's input, with the deflection. weights: a file; empty: the shipped
    one. The network does not estimate friction: the reply carries the value that the cell's file expects.
    """

    def __init__(self, context: ServiceContext, weights: str, observation: Callable[[Touch], TouchObservation]) -> None:
        self._workcell: Workcell = context.cell.workcell
        self._path = Path(weights) if weights else SEQUENCE_WEIGHTS
        self._observation = observation
        self._network: object | None = None
        if not self._path.is_file():
            context.event(Severity.WARNING, "sequence_network", f"no weights at {self._path}")
        context.bus.serve(SEQUENCE_NETWORK, refuse_implausible_answers(self.estimate))

    def estimate(self, request: EstimateBySequence) -> PoseErrorEstimate:
        """The hole's pose from the touches so far. Refused as no_weights if there are none for this peg, and as
        no_torch if torch is not installed.
        """
        try:
            from services.inference.network.sequence.model import SequenceNetwork, history_of
        except ImportError as error:
            raise CommandRefused("no_torch", f"torch cannot be loaded ({error}): {ALL_PACKAGES}") from error
        started = time.perf_counter()
        refuse_implausible_touches(request.prior, request.touches, self._workcell.peg.shape().tip_m)
        if self._network is None:
            try:
                self._network = SequenceNetwork.load(self._path, self._workcell.peg.shape())
            except (OSError, ValueError) as error:
                raise CommandRefused(
                    "no_weights", f"{error}; make some with `python -m services.inference.network sequence`"
                ) from None
        assert isinstance(self._network, SequenceNetwork)
        observations = [self._observation(touch) for touch in request.touches]
        poses = [observation.deflected_pose_base_peg() for observation in observations]
        prior = request.prior.pose_base_hole.pose()
        prior_covariance = np.asarray(request.prior.covariance).reshape(6, 6)
        history = history_of(
            prior,
            np.sqrt(np.diag(prior_covariance)),
            poses,
            [observation.wrench_peg for observation in observations],
            [observation.motion_direction_base for observation in observations],
        )
        pose, covariance = self._network.pose(prior, history)
        pose_peg_hole = poses[-1].inverse() @ pose
        root = np.linalg.cholesky(prior_covariance)
        white = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
        return PoseErrorEstimate(
            pose_base_hole=PoseData.of(pose),
            covariance=floats(covariance),
            angles_rad=floats(rotation_to_error_angles(pose_peg_hole.rotation)),
            translation_m=floats(pose_peg_hole.translation_m),
            rank=int(np.count_nonzero(np.linalg.eigvalsh(0.5 * (white + white.T)) < NARROWED)),
            residual_cost=0.0,
            friction=self._workcell.friction_expected,
            friction_sd=0.0,
            method="sequence",
            rests_on=tuple(
                TouchUse(index=touch.index, used=True, hypothesis="history of touches", residual_sigma=0.0)
                for touch in request.touches
            ),
            compute_s=time.perf_counter() - started,
        )
