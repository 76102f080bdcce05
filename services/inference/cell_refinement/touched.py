"""Residuals of touches before the hole: wrench and gaps of the contacts of each, as in the estimator.

The touching features are chosen at one state (`TouchModel.of`); from there on they move smoothly with the poses, the
sensor, and (linearly) with the taper and the clearance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from services.inference.cell_refinement.parameters import CLEARANCE, TAPER, shapes
from services.inference.estimator import EstimatorSettings
from services.inference.estimator.fit import whitening
from services.inference.estimator.hypotheses import TouchBatch, TrialPoses, choose_contacts
from services.inference.mechanics import (
    ContactFeatures,
    PairTables,
    contact_geometry,
    contact_wrench_basis,
    first_contacts,
)

STEPS = {TAPER: 1e-3, CLEARANCE: 2e-6}  # far above rounding, far below a change of features
SAME_FEATURE = 0.02
VECTORS = ("peg_point_m", "peg_direction", "hole_point_m", "hole_direction")


@dataclass(frozen=True, slots=True, eq=False)
class TouchState:
    """T touches at given parameters, each against its own hole: peg in hole (T, 3, 3), (T, 3) m; wrench on the peg (T,
    6), N and Nm; motion (T, 3) in the hole frame."""

    rotation: Array
    translation_m: Array
    wrench: Array
    motion_hole: Array


@dataclass(frozen=True, slots=True, eq=False)
class TouchModel:
    """The contacts chosen for T touches: C that press and Q that overlap, and the derivatives of their features.

    slopes: by parameter, the change of each vector of the features per unit. weight (T,): how well each touch is
    explained, 1 to 0. start: the shape parameters at which the features were found.
    """

    pressed: ContactFeatures
    pressing: NDArray[np.bool_]
    others: ContactFeatures
    overlapping: NDArray[np.bool_]
    slopes: dict[int, tuple[dict[str, Array], dict[str, Array]]]
    start: Array
    compliance: Array
    gap_sd_m: float
    wrench_sd: Array
    weight: Array

    @classmethod
    def of(
        cls, workcell: Workcell, state: TouchState, parameters: Array, friction: float, sd: Array, compliance: Array,
        settings: EstimatorSettings, softness: float,
    ) -> TouchModel:  # fmt: skip
        """Choose the contacts. sd (T, 6): of the wrenches; softness: 1 at the start, 0 for the true noise."""

        def tables(taper: float, clearance_m: float) -> PairTables:
            return PairTables.of(*shapes(workcell, taper, clearance_m))

        count = len(sd)
        here = np.array([parameters[TAPER], parameters[CLEARANCE]])
        base = tables(*here)
        batch = TouchBatch(state.rotation, state.translation_m, state.wrench, sd, compliance, state.motion_hole)
        # every pose is expressed in its own hole's frame, so one table of the hole serves all
        trials = TrialPoses(np.eye(3)[None], np.zeros((1, 3)), np.array([friction]))
        gap_sd, wrench_sd = whitening(batch, settings, softness)
        chosen = choose_contacts(base, trials, batch, gap_sd, wrench_sd, settings)
        rows = np.arange(count)[:, None]
        columns = chosen.columns[0]
        others = chosen.features[0]
        pairs = chosen.pair[0]
        slopes = {}
        for index, step in STEPS.items():
            moved = here + step * np.eye(2)[index]
            found = first_contacts(tables(*moved), state.rotation, state.translation_m, state.motion_hole)
            slope = _slopes(others, found.features[rows, pairs], step)
            slopes[index] = {name: value[rows, columns] for name, value in slope.items()}, slope
        gate = settings.gate * (1.0 + 20.0 * softness)
        return cls(
            others[rows, columns], chosen.pressing[0], others, chosen.overlapping[0], slopes, here, compliance,
            gap_sd, wrench_sd, 1.0 / (1.0 + np.maximum(chosen.cost[0], 0.0) / gate),
        )  # fmt: skip

    def residual(self, state: TouchState, parameters: Array, friction: float) -> Array:
        """(T, 6 + C + Q): wrench, gaps of pressing contacts, overlaps of the others, in sds; forces are fitted."""
        rotation, translation = state.rotation[:, None], state.translation_m[:, None]
        geometry = contact_geometry(self._moved(self.pressed, parameters, 0), rotation, translation)
        motion_peg = np.einsum("tji,tj->ti", state.rotation, state.motion_hole)
        basis = contact_wrench_basis(
            geometry.normal_peg, geometry.point_peg_m, motion_peg[:, None], friction, self.compliance[:, None]
        )
        basis = basis / self.wrench_sd[:, None] * self.pressing[..., None]
        target = state.wrench / self.wrench_sd
        gram = basis @ np.swapaxes(basis, 1, 2)
        ridge = np.where(self.pressing, 1e-9 * np.einsum("tii->t", gram)[:, None], 1.0)
        gram = gram + ridge[:, None] * np.eye(gram.shape[1])
        force = np.linalg.solve(gram, np.einsum("tci,ti->tc", basis, target)[..., None])[..., 0]
        wrench = target - np.einsum("tci,tc->ti", basis, np.maximum(force, 0.0))
        gap = np.where(self.pressing, geometry.gap_m, 0.0) / self.gap_sd_m
        beside = contact_geometry(self._moved(self.others, parameters, 1), rotation, translation)
        overlap = np.where(self.overlapping, np.minimum(beside.gap_m, 0.0), 0.0) / self.gap_sd_m
        return np.asarray(np.concatenate([wrench, gap, overlap], axis=1) * np.sqrt(self.weight)[:, None])

    def _moved(self, features: ContactFeatures, parameters: Array, which: int) -> ContactFeatures:
        change = np.array([parameters[TAPER], parameters[CLEARANCE]]) - self.start
        vectors = {
            name: getattr(features, name) + sum(change[index] * self.slopes[index][which][name] for index in STEPS)
            for name in VECTORS
        }
        return ContactFeatures(features.kind, sign=features.sign, **vectors)


def _slopes(before: ContactFeatures, after: ContactFeatures, step: float) -> dict[str, Array]:
    """Change of each vector of the features per unit of a parameter; zero where another feature took over."""
    change = {name: getattr(after, name) - getattr(before, name) for name in VECTORS}
    same = (before.kind == after.kind) & (before.sign == after.sign)
    for name in VECTORS:
        size = np.linalg.norm(change[name], axis=-1)
        same &= size < (SAME_FEATURE if name.endswith("direction") else SAME_FEATURE * 0.1)
    return {name: np.where(same[..., None], value, 0.0) / step for name, value in change.items()}
