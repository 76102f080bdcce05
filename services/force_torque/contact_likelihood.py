"""Which of the 26 contact states a wrench shows, by the mechanics: the likelihood of each set of touching edges.

For every set of taper edges (contact_sets.py) the best fitting pose, friction and forces are found, and the likelihood
of the wrench is integrated over them (Laplace's method; MacKay, "Information Theory, Inference, and Learning
Algorithms", chapter 28). So a set with more contacts, which can explain more, has to fit better. A wrench that no set
explains is in none of the states. A state's confidence is its share of the total.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell
from crosspih_common.contacts import ArmEdges
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg
from services.force_torque.contact_sets import EdgeSets, FitScales, SetFits, SetModel, all_edge_sets
from services.force_torque.contact_state import ClassifierSettings, ContactStateResult, wrench_signs
from services.force_torque.contact_table import STATES


@dataclass(frozen=True, slots=True)
class Belief:
    """Converts evidence to confidence; tuned so that the confidence equals the hit rate (`crosspih bench states`).

    `temperature_few` divides the log evidence if the best set has one or two edges, `temperature_many` if it has more:
    then a set has as many unknowns as the wrench has numbers, and several sets fit about as well. `other_pairs` and
    `other_threes` are added for the sets that are none of the 26. `nothing` is the log evidence of "no set of taper
    edges": a face, the end of an arm, the body.
    """

    temperature_few: float = 2.7
    temperature_many: float = 10.0
    other_pairs: float = 0.0
    other_threes: float = -8.0
    nothing: float = -58.0


def nominal_compliance_peg(workcell: Workcell, depth_m: float) -> Array:
    """(6, 6): `Workcell.compliance_peg` with the peg's tip at `depth_m` in the nominal hole."""
    pose = workcell.hole_prior.pose_base_hole() @ Pose.from_translation(
        [0.0, 0.0, depth_m - workcell.peg.shape().tip_m]
    )
    joints = nearest(workcell.arm(), pose @ workcell.pose_flange_peg().inverse(), workcell.home_joints_rad)
    return workcell.compliance_peg(joints)


class LikelihoodClassifier:
    """Classifies wrenches on the cross peg of one cell."""

    def __init__(
        self, peg: Peg, hole: Hole, compliance_peg: Array, friction: float, scales: FitScales | None = None,
        belief: Belief | None = None,
    ) -> None:  # fmt: skip
        self._sets = all_edge_sets()
        self._belief = Belief() if belief is None else belief
        self._model = SetModel(
            edges=ArmEdges.of(peg, hole),
            compliance_peg=compliance_peg,
            friction=friction,
            rim_ahead_m=peg.taper_start_m + 0.3 * peg.taper_length_m,
            chamfer_m=hole.chamfer_m,
            scales=FitScales() if scales is None else scales,
        )
        self._signs = ClassifierSettings(friction=friction)

    @classmethod
    def of(cls, workcell: Workcell) -> LikelihoodClassifier:
        """For a cell's drawings, arm and expected friction. Raises ValueError when its peg is no cross."""
        peg = workcell.peg.shape()
        hole = workcell.hole.shape(peg)
        depth_m = hole.chamfer_m + 0.7 * peg.taper_length_m
        return cls(peg, hole, nominal_compliance_peg(workcell, depth_m), workcell.friction_expected)

    def classify(self, wrench_peg: ArrayLike, wrench_sd: ArrayLike) -> ContactStateResult:
        """The state of a compensated wrench (6,) on the peg, in the peg frame, with its standard deviations (6,).

        Raises ValueError unless all are finite.
        """
        wrench, sd = np.asarray(wrench_peg, dtype=float), np.asarray(wrench_sd, dtype=float)
        if wrench.shape != (6,) or sd.shape != (6,) or not np.all(np.isfinite([wrench, sd])):
            raise ValueError(f"wrench_peg and wrench_sd want six finite numbers each, got {wrench!r} and {sd!r}")
        force = float(np.linalg.norm(wrench[:3]))
        n_z0 = -float(wrench[2]) / force if force > 0.0 else 0.0
        signs = wrench_signs(wrench, self._signs)
        if force < self._signs.minimum_force_n:
            return ContactStateResult(None, 0.0, f"no contact: |F| = {force:.2f} N", n_z0, signs)
        if wrench[2] >= 0.0:
            reason = f"Fz = {wrench[2]:.2f} N does not push the peg back: not a taper contact"
            return ContactStateResult(None, 0.0, reason, n_z0, signs)
        fits = self._model.fit(self._sets, wrench, sd)
        shares = self.shares(fits)
        order = np.argsort(-shares, kind="stable")
        best, second = int(order[0]), int(order[1])
        state = STATES[best] if best < len(STATES) else None
        return ContactStateResult(
            state=state,
            confidence=float(shares[best]),
            reason="" if state is not None else self._why(fits),
            n_z0=n_z0,
            signs=signs,
            runner_up=STATES[second] if second < len(STATES) else None,
            runner_up_confidence=float(shares[second]),
        )

    def shares(self, fits: SetFits) -> Array:
        """(27,): the probability of each of STATES, and last of none of them."""
        belief, sets = self._belief, fits.sets
        many = sets.count[np.argmax(fits.evidence)] > 2
        scores = np.append(self._scores(fits), belief.nothing)
        scores = scores / (belief.temperature_many if many else belief.temperature_few)
        weights = np.exp(scores - scores.max())
        where = np.append(np.where(sets.state < 0, len(STATES), sets.state), len(STATES))
        found = np.bincount(where, weights, minlength=len(STATES) + 1)
        return np.asarray(found / found.sum())

    def _scores(self, fits: SetFits) -> Array:
        others = np.where(fits.sets.count == 2, self._belief.other_pairs, self._belief.other_threes)
        return np.asarray(fits.evidence + np.where(fits.sets.state < 0, others, 0.0))

    def _why(self, fits: SetFits) -> str:
        """The reason for none of the 26: another set explains the wrench, or no set does."""
        scores = self._scores(fits)
        best = int(np.argmax(scores))
        if scores[best] < self._belief.nothing:
            misfit = fits.cost[best]
            return f"no set of taper edges explains it (misfit {misfit:.0f}): a face, an arm's end or the body"
        other = int(np.argmax(np.where(fits.sets.state < 0, scores, -np.inf)))
        if fits.sets.state[other] >= 0:
            return f"no set of taper edges explains it better than others: {_named(fits.sets, best)} best"
        said = f"{_kind(fits.sets, other)}: {_named(fits.sets, other)}"
        return said if fits.sets.state[best] < 0 else f"many sets explain it about as well; {said}"


def _edges_of(sets: EdgeSets, index: int) -> list[tuple[int, int]]:
    """(arm, sense) of each edge of a set."""
    return [(int(edge) // 2 + 1, int(edge) % 2 + 1) for edge in sets.edges[index][sets.used[index]]]


def _named(sets: EdgeSets, index: int) -> str:
    return ", ".join(f"arm {arm} in sense {sense}" for arm, sense in _edges_of(sets, index))


def _kind(sets: EdgeSets, index: int) -> str:
    senses = {sense for _, sense in _edges_of(sets, index)}
    return "walls of both senses" if len(senses) == 2 else "opposite arms"
