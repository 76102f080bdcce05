"""The sets of taper edges that can be in contact, and how well each explains a wrench: geometry and mechanics.

Eight edges can touch: two at the end of each arm, one per sense (crosspih_common/contacts). The 26 states are 26 of
their subsets. For one subset the unknowns are the pose of the peg in the hole, the friction coefficient, and the force
on each edge (as a logarithm, so that it only presses). The first edge meets its rim by construction. The residuals are
the prior, the wrench minus the sum of the edges' wrenches (with friction against the sliding of all of them, Eqs.
20-24), the gaps of the subset's other edges, and overlaps of the rest. Least squares by damped Gauss-Newton, with
looser weights at first.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from crosspih_common.contacts import ArmEdges, edge_index
from crosspih_common.geometry.pose import Array
from services.force_torque.contact_table import STATES

SLOTS = 4
POSE = 6  # alpha, beta, gamma, the first contact's place along its peg edge and along its rim, friction
UNKNOWNS = POSE + SLOTS
FELT, MET, CLEAR = 6, SLOTS - 1, 8
RESIDUALS = FELT + MET + CLEAR + POSE + 1 + SLOTS
Z = np.array([0.0, 0.0, 1.0])
NO_STATE = -1


@dataclass(frozen=True, slots=True, eq=False)
class EdgeSets:
    """H subsets: edges (H, 4), padded with the first; used (H, 4); state (H,) index into STATES or -1 for none."""

    edges: NDArray[np.int64]
    used: NDArray[np.bool_]
    state: NDArray[np.int64]

    def __getitem__(self, index: NDArray[np.int64]) -> EdgeSets:
        return EdgeSets(self.edges[index], self.used[index], self.state[index])

    @property
    def count(self) -> NDArray[np.int64]:
        """The number of edges of each subset (H,)."""
        return np.asarray(self.used.sum(axis=1))


def all_edge_sets() -> EdgeSets:
    """The 26 states in the order of STATES, then every other pair and every other three of edges on different arms."""
    named = [tuple(edge_index(arm, row.sense) for arm in row.arms) for row in STATES]
    others = [
        chosen
        for size in (2, 3)
        for chosen in combinations(range(8), size)
        if len({edge // 2 for edge in chosen}) == size and chosen not in named
    ]
    rows = [*named, *others]
    edges = np.array([[*row, *[row[0]] * (SLOTS - len(row))] for row in rows])
    used = np.array([[True] * len(row) + [False] * (SLOTS - len(row)) for row in rows])
    state = np.array([*range(len(named)), *[NO_STATE] * len(others)])
    return EdgeSets(edges, used, state)


@dataclass(frozen=True, slots=True)
class FitScales:
    """One standard deviation of the unknowns' priors, and how far the model is trusted.

    Angles, lateral offset and depth of the hole's rim in the peg; friction about the expected one; the logarithm of
    each force about that of the total; `gap_m`: how exactly edges meet; floors of the wrench's noise, and the share of
    force and moment that the model may miss. `coarse_share`: the same share at the start of the search, by which
    `candidates` subsets are chosen; `finalists` of these remain after `first_iterations` steps with wrench and gaps
    `first_looseness` times looser.
    """

    angle_rad: float = 0.06
    lateral_m: float = 0.003
    depth_m: float = 0.008
    friction: float = 0.04
    log_force: float = 1.0
    gap_m: float = 2e-5
    force_floor_n: float = 0.02
    moment_floor_nm: float = 0.001
    share: float = 0.004
    coarse_share: float = 0.1
    candidates: int = 16
    first_looseness: float = 10.0
    first_iterations: int = 4
    finalists: int = 8
    more_iterations: int = 4


@dataclass(frozen=True, slots=True, eq=False)
class SetFits:
    """For H subsets: cost (H,) the sum of squares at the best fit; evidence (H,) the log of the likelihood with the
    unknowns integrated out (Laplace), up to a constant; unknowns (H, 10) in standard deviations about their prior
    means.
    """

    sets: EdgeSets
    cost: Array
    evidence: Array
    unknowns: Array


@dataclass(slots=True, eq=False)
class _Search:
    """The state of damped Gauss-Newton for H subsets."""

    unknowns: Array
    kept: Array
    cost: Array
    residual: Array
    jacobian: Array
    damping: Array

    @classmethod
    def begin(cls, unknowns: Array) -> _Search:
        h = len(unknowns)
        return cls(
            unknowns, unknowns, np.full(h, np.inf), np.zeros((h, RESIDUALS)),
            np.zeros((h, RESIDUALS, UNKNOWNS)), np.full(h, 0.1),
        )  # fmt: skip

    def evidence(self) -> Array:
        information = np.einsum("hri,hrj->hij", self.jacobian, self.jacobian)
        return np.asarray(-0.5 * (self.cost + np.linalg.slogdet(information)[1]))


@dataclass(frozen=True, slots=True, eq=False)
class SetModel:
    """The cell's data for the fit: the edges, the arm's compliance (6, 6) in the peg frame, the expected friction, the
    expected distance of the rim from the peg frame's origin, m, and the rim's depth below the hole's face, m.
    """

    edges: ArmEdges
    compliance_peg: Array
    friction: float
    rim_ahead_m: float
    chamfer_m: float
    scales: FitScales = FitScales()

    def _spread(self) -> tuple[Array, Array]:
        """Mean (6,) and scale (6,) of the unknowns of the pose."""
        q = self.scales
        along, out = 0.5 * float(self.edges.length_m.mean()), 0.5 * (self.edges.root_m + self.edges.end_m)
        mean = np.array([0.0, 0.0, 0.0, along, out, self.friction])
        return mean, np.array([q.angle_rad] * 3 + [q.depth_m, q.lateral_m, max(q.friction, 1e-3)])

    def wrench_sd(self, wrench: Array, sensor_sd: Array) -> Array:
        """(6,): the sensor's noise and the model's error combined."""
        s = self.scales
        force, moment = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
        floor = np.repeat([s.force_floor_n, s.moment_floor_nm], 3)
        share = np.repeat([s.share * force, s.share * moment], 3)
        return np.asarray(np.sqrt(sensor_sd**2 + floor**2 + share**2))

    def _contacts(self, pose: Array, sets: EdgeSets) -> tuple[Array, Array]:
        """Bases (H, 4, 6) and the residuals (H, 18) of gaps and prior at whitened poses and friction (H, 6).

        The first edge meets its rim by construction, so only the others' gaps are residuals.
        """
        mean, spread = self._spread()
        x = mean + pose * spread
        first = sets.edges[:, 0]
        rotation = _hole_peg(x[:, :3])
        point = self.edges.tip_m[first] + x[:, 3:4] * self.edges.along[first]
        on_rim = self.edges.rim_m[first] + x[:, 4:5] * self.edges.outward[first]
        translation = on_rim - np.einsum("hij,hj->hi", rotation, point)
        contact = self.edges.at(rotation, translation)
        rows = np.arange(len(x))[:, None]
        basis = self._bases(
            contact.normal_peg[rows, sets.edges], contact.point_peg_m[rows, sets.edges], np.maximum(x[:, 5], 0.0),
            sets.used,
        )  # fmt: skip
        gap = contact.gap_m / self.scales.gap_m
        free = np.ones(gap.shape, dtype=bool)
        np.put_along_axis(free, sets.edges, False, axis=1)
        centre = -translation
        centre[:, 2] += self.chamfer_m
        rim = np.einsum("hij,hi->hj", rotation, centre)
        lateral, depth = self.scales.lateral_m, self.scales.depth_m
        offset = (rim - [0.0, 0.0, self.rim_ahead_m]) / [lateral, lateral, depth]
        return basis, np.concatenate(
            [
                (gap[rows, sets.edges] * sets.used)[:, 1:],
                np.minimum(gap, 0.0) * free,
                pose[:, :3],
                offset,
                pose[:, 5:],
            ],
            axis=1,
        )

    def _bases(self, normal: Array, point: Array, friction: Array, used: NDArray[np.bool_]) -> Array:
        """Wrenches (H, 4, 6) of 1 N on each edge of a subset while the peg is driven along z and all edges slide."""
        pure = np.concatenate([normal, np.cross(point, normal)], axis=-1) * used[..., None]
        gives = pure @ self.compliance_peg.T
        coupling = np.einsum("hki,hli->hkl", pure, gives)
        size = np.einsum("hkk->h", coupling)
        coupling = coupling + (size[:, None] * np.where(used, 1e-4, 1.0))[..., None] * np.eye(SLOTS)
        closing = np.linalg.solve(coupling, pure[..., 2:3])[..., 0]
        twist = -np.einsum("hk,hki->hi", closing, gives)
        velocity = Z + twist[:, None, :3] + np.cross(twist[:, None, 3:], point)
        velocity = velocity - normal * np.einsum("hki,hki->hk", normal, velocity)[..., None]
        speed = np.maximum(np.sqrt(np.einsum("hki,hki->hk", velocity, velocity)), 1e-9)
        force = normal - (friction[:, None] / speed)[..., None] * velocity
        return np.concatenate([force, np.cross(point, force)], axis=-1) * used[..., None]

    def _start(self, sets: EdgeSets, wrench: Array, sd: Array) -> tuple[Array, Array]:
        """The start of the search (H, 10): rotated by the subset's sense, contacts halfway along, forces by least
        squares; and its distance from the wrench (H,), as a share of the wrench's size.
        """
        start = np.zeros((len(sets.edges), UNKNOWNS))
        sense = np.where(sets.edges % 2 == 1, 1.0, -1.0)
        turn = np.where(sets.used, sense, 0.0).sum(axis=1) / sets.count
        start[:, 0] = 0.05 * turn / self.scales.angle_rad
        basis, _ = self._contacts(start[:, :POSE], sets)
        white = basis / sd
        square = np.einsum("hki,hli->hkl", white, white)
        size = np.einsum("hkk->h", square)
        square = square + (size[:, None] * np.where(sets.used, 1e-3, 1.0))[..., None] * np.eye(SLOTS)
        force = np.linalg.solve(square, np.einsum("hki,i->hk", white, wrench / sd)[..., None])[..., 0]
        whole = float(np.linalg.norm(wrench[:3]))
        start[:, POSE:] = np.log(np.clip(force / whole, 0.1, 3.0)) / self.scales.log_force * sets.used
        size = np.repeat([whole, float(np.linalg.norm(wrench[3:])) + 0.01 * whole], 3)
        miss = (np.einsum("hki,hk->hi", basis, np.maximum(force, 0.0)) - wrench) / (self.scales.coarse_share * size)
        return start, np.einsum("hi,hi->h", miss, miss) + 2.0 * sets.count

    def _linearise(
        self, unknowns: Array, sets: EdgeSets, wrench: Array, sd: Array, looseness: float
    ) -> tuple[Array, Array]:
        """Residuals (H, 28) in standard deviations, those of wrench and gaps divided by `looseness`, and their
        derivatives (H, 28, 10).
        """
        h = len(unknowns)
        step = 1e-3
        tried = (unknowns[:, None, :POSE] + np.vstack([np.zeros(POSE), step * np.eye(POSE)])).reshape(-1, POSE)
        times = POSE + 1
        every = EdgeSets(
            np.repeat(sets.edges, times, 0), np.repeat(sets.used, times, 0), np.repeat(sets.state, times, 0)
        )
        basis, others = self._contacts(tried, every)
        whole = float(np.linalg.norm(wrench[:3]))
        force = whole * np.exp(np.clip(self.scales.log_force * unknowns[:, POSE:], -8.0, 3.0)) * sets.used
        white = basis.reshape(h, times, SLOTS, 6) / sd
        felt = np.einsum("hekr,hk->her", white, force) - wrench / sd
        parts = np.concatenate([felt, others.reshape(h, times, -1)], axis=2)
        parts[:, :, : FELT + MET + CLEAR] /= looseness
        residual = np.concatenate([parts[:, 0], unknowns[:, POSE:]], axis=1)
        jacobian = np.zeros((h, RESIDUALS, UNKNOWNS))
        jacobian[:, :-SLOTS, :POSE] = np.swapaxes((parts[:, 1:] - parts[:, :1]) / step, 1, 2)
        jacobian[:, :FELT, POSE:] = np.swapaxes(
            white[:, 0] * (self.scales.log_force / looseness * force)[..., None], 1, 2
        )
        jacobian[:, -SLOTS:, POSE:] = np.eye(SLOTS)
        return residual, jacobian

    def _search(
        self, search: _Search, sets: EdgeSets, wrench: Array, sd: Array, iterations: int, looseness: float = 1.0
    ) -> None:
        for _ in range(iterations):
            residual, jacobian = self._linearise(search.unknowns, sets, wrench, sd, looseness)
            cost = np.einsum("hi,hi->h", residual, residual)
            better = cost < search.cost
            search.cost = np.where(better, cost, search.cost)
            search.kept = np.where(better[:, None], search.unknowns, search.kept)
            search.residual = np.where(better[:, None], residual, search.residual)
            search.jacobian = np.where(better[:, None, None], jacobian, search.jacobian)
            search.damping = np.where(better, np.maximum(0.1 * search.damping, 1e-7), 10.0 * search.damping)
            information = np.einsum("hri,hrj->hij", search.jacobian, search.jacobian)
            lifted = information + (search.damping[:, None] * np.einsum("hii->hi", information))[..., None] * np.eye(
                UNKNOWNS
            )
            downhill = np.einsum("hri,hr->hi", search.jacobian, search.residual)
            step = np.linalg.solve(lifted, downhill[..., None])[..., 0]
            longest = np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12)
            search.unknowns = search.kept - step * np.minimum(1.0, 2.5 / longest)

    def fit(self, sets: EdgeSets, wrench: Array, sensor_sd: Array) -> SetFits:
        """The best subsets' fits to a wrench (6,) with the sensor's sd (6,).

        A few steps for the subsets whose start is near the wrench, more for the best of them.
        """
        sd = self.wrench_sd(wrench, sensor_sd)
        start, far = self._start(sets, wrench, sd)
        near = np.argsort(far, kind="stable")[: self.scales.candidates]
        search, sets = _Search.begin(start[near]), sets[near]
        self._search(search, sets, wrench, sd, self.scales.first_iterations, self.scales.first_looseness)
        best = np.argsort(-search.evidence(), kind="stable")[: self.scales.finalists]
        search, sets = _Search.begin(search.kept[best]), sets[best]
        self._search(search, sets, wrench, sd, self.scales.more_iterations)
        return SetFits(sets, search.cost, search.evidence(), search.kept)


def _hole_peg(angles: Array) -> Array:
    """rotation_hole_peg (H, 3, 3) of error angles (H, 3) = (alpha, beta, gamma): the transpose of Rz Rx Ry."""
    (ca, cb, cg), (sa, sb, sg) = np.cos(angles).T, np.sin(angles).T
    rotation = np.empty((len(angles), 3, 3))
    rotation[:, 0, 0], rotation[:, 1, 0], rotation[:, 2, 0] = ca * cb - sa * sg * sb, -sa * cg, ca * sb + sa * sg * cb
    rotation[:, 0, 1], rotation[:, 1, 1], rotation[:, 2, 1] = sa * cb + ca * sg * sb, ca * cg, sa * sb - ca * sg * cb
    rotation[:, 0, 2], rotation[:, 1, 2], rotation[:, 2, 2] = -cg * sb, sg, cg * cb
    return rotation
