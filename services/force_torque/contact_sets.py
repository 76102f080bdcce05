"""The sets of taper edges that a contact may rest on, and how well each explains a wrench: geometry and mechanics.

Eight edges can touch: two at the end of each arm, one a sense (crosspih_common/contacts). The 26 states are 26 of
their subsets. For one subset the unknowns are the pose of the peg in the hole (three angles, lateral offset, depth), the
friction coefficient, and a force f >= 0 on each edge; the forces follow from the wrench by least squares, the rest is
fitted: the wrench must be their sum, the edges of the subset must meet their rims, no other may cross its own.
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
Z = np.array([0.0, 0.0, 1.0])
NO_STATE = -1
_RIDGE = 1e-9
_LEAST_DAMPING = 1e-3


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
        """How many edges each has (H,)."""
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
    """One standard deviation of what is not known before, and how far the model is trusted.

    Angles, lateral offset and depth of the hole's rim in the peg; friction about the expected one; `gap_m`: how exactly
    edges meet; floors of the wrench's noise, and the share of force and moment that the model may miss.
    """

    angle_rad: float = 0.06
    lateral_m: float = 0.003
    depth_m: float = 0.008
    friction: float = 0.03
    gap_m: float = 2e-5
    force_floor_n: float = 0.03
    moment_floor_nm: float = 0.0015
    share: float = 0.01
    iterations: int = 7


@dataclass(frozen=True, slots=True, eq=False)
class SetFits:
    """For H subsets: cost (H,) the sum of squares at the best fit; volume (H,) minus half the log of the determinant of
    the information on pose and forces, in units of the prior; force_n (H, 4).
    """

    cost: Array
    volume: Array
    force_n: Array
    unknowns: Array


@dataclass(frozen=True, slots=True, eq=False)
class SetModel:
    """What the fit needs of the cell: the edges, the arm's compliance (6, 6) in the peg frame, the friction expected."""

    edges: ArmEdges
    compliance_peg: Array
    friction: float
    rim_ahead_m: float
    chamfer_m: float
    scales: FitScales = FitScales()

    def start(self, sets: EdgeSets) -> Array:
        """Where the search begins (H, 7): alpha, beta, gamma, rim's x, y, z in the peg frame, friction.

        Turned by the sense of the subset, centred; the depth is put right by the first step, for gaps are linear in it.
        """
        sense = np.where(sets.edges % 2 == 1, 1.0, -1.0)
        turn = np.where(sets.used, sense, 0.0).sum(axis=1) / sets.count
        start = np.zeros((len(sets.edges), 7))
        start[:, 0] = 0.05 * turn
        start[:, 5] = self.rim_ahead_m
        start[:, 6] = self.friction
        return start

    def prior(self) -> tuple[Array, Array]:
        """Mean (7,) and standard deviation (7,) of the unknowns."""
        s = self.scales
        mean = np.array([0.0, 0.0, 0.0, 0.0, 0.0, self.rim_ahead_m, self.friction])
        sd = np.array([s.angle_rad] * 3 + [s.lateral_m] * 2 + [s.depth_m, max(s.friction, 1e-3)])
        return mean, sd

    def wrench_sd(self, wrench: Array, sensor_sd: Array) -> Array:
        """(6,): the sensor's noise and the model's own."""
        s = self.scales
        force, moment = np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])
        floor = np.repeat([s.force_floor_n, s.moment_floor_nm], 3)
        share = np.repeat([s.share * force, s.share * moment], 3)
        return np.asarray(np.sqrt(sensor_sd**2 + floor**2 + share**2))

    def residuals(self, unknowns: Array, sets: EdgeSets, wrench: Array, sd: Array) -> tuple[Array, Array, Array]:
        """(H, 25) residuals in standard deviations, the forces (H, 4), N, and the whitened bases (H, 6, 4)."""
        rotation = _hole_peg(unknowns[:, :3])
        translation = -np.einsum("hij,hj->hi", rotation, unknowns[:, 3:6])
        translation[:, 2] += self.chamfer_m
        contact = self.edges.at(rotation, translation)
        rows = np.arange(len(unknowns))[:, None]
        normal, point = contact.normal_peg[rows, sets.edges], contact.point_peg_m[rows, sets.edges]
        basis = self._bases(normal, point, np.maximum(unknowns[:, 6], 0.0), sets.used)
        white = np.swapaxes(basis * sets.used[..., None], 1, 2) / sd[None, :, None]
        target = wrench / sd
        square = np.einsum("hik,hil->hkl", white, white)
        scale = np.maximum(np.einsum("hkk->h", square), 1e-9)
        square = square + (_RIDGE * scale[:, None] + ~sets.used)[..., None] * np.eye(SLOTS)
        force = np.linalg.solve(square, np.einsum("hik,i->hk", white, target)[..., None])[..., 0]
        force = np.maximum(force, 0.0)
        felt = target - np.einsum("hik,hk->hi", white, force)
        mean, spread = self.prior()
        gap = contact.gap_m / self.scales.gap_m
        touching = gap[rows, sets.edges] * sets.used
        crossing = np.minimum(gap, 0.0)
        crossing[rows, sets.edges] *= ~sets.used
        np.put_along_axis(crossing, sets.edges[:, :1], 0.0, axis=1)
        return np.concatenate([felt, touching, crossing, (unknowns - mean) / spread], axis=1), force, white

    def _bases(self, normal: Array, point: Array, friction: Array, used: NDArray[np.bool_]) -> Array:
        """Wrenches (H, 4, 6) of 1 N on each edge of a subset while the peg is driven along z and all of them slide."""
        pure = np.concatenate([normal, np.cross(point, normal)], axis=-1)
        gives = pure @ self.compliance_peg.T
        coupling = np.einsum("hki,hli->hkl", pure, gives) * (used[:, :, None] & used[:, None])
        size = np.einsum("hkk->h", coupling)
        coupling = coupling + ((1e-4 * size)[:, None] * used + size[:, None] * ~used)[..., None] * np.eye(SLOTS)
        closing = np.linalg.solve(coupling, (normal @ Z * used)[..., None])[..., 0]
        twist = -np.einsum("hk,hki->hi", closing, gives)
        velocity = Z + twist[:, None, :3] + np.cross(twist[:, None, 3:], point)
        velocity = velocity - normal * np.einsum("hki,hki->hk", normal, velocity)[..., None]
        speed = np.maximum(np.linalg.norm(velocity, axis=-1, keepdims=True), 1e-9)
        force = normal - friction[:, None, None] * velocity / speed
        return np.concatenate([force, np.cross(point, force)], axis=-1)

    def fit(self, sets: EdgeSets, wrench: Array, sensor_sd: Array) -> SetFits:
        """Each subset's best fit to a wrench (6,) with the sensor's sd (6,), by damped Gauss-Newton."""
        sd = self.wrench_sd(wrench, sensor_sd)
        _, spread = self.prior()
        steps = 1e-3 * spread
        count = len(sets.edges)
        unknowns = self.start(sets)
        eight = EdgeSets(np.repeat(sets.edges, 8, 0), np.repeat(sets.used, 8, 0), np.repeat(sets.state, 8, 0))
        offsets = np.vstack([np.zeros(7), np.diag(steps)])
        damping = np.full(count, 1e-2)
        best = np.full(count, np.inf)
        kept = unknowns
        jacobian = np.zeros((count, 25, 7))
        residual = np.zeros((count, 25))
        force, white = np.zeros((count, SLOTS)), np.zeros((count, 6, SLOTS))
        for _ in range(self.scales.iterations):
            tried = (unknowns[:, None] + offsets).reshape(-1, 7)
            all_residuals, all_forces, all_white = self.residuals(tried, eight, wrench, sd)
            every = all_residuals.reshape(count, 8, 25)
            cost = np.einsum("hi,hi->h", every[:, 0], every[:, 0])
            better = cost < best
            best = np.where(better, cost, best)
            kept = np.where(better[:, None], unknowns, kept)
            slopes = np.swapaxes((every[:, 1:] - every[:, :1]) / 1e-3, 1, 2)
            jacobian = np.where(better[:, None, None], slopes, jacobian)
            residual = np.where(better[:, None], every[:, 0], residual)
            force = np.where(better[:, None], all_forces.reshape(count, 8, SLOTS)[:, 0], force)
            white = np.where(better[:, None, None], all_white.reshape(count, 8, 6, SLOTS)[:, 0], white)
            damping = np.where(better, np.maximum(0.1 * damping, _LEAST_DAMPING), 10.0 * damping)
            information = np.einsum("hri,hrj->hij", jacobian, jacobian)
            diagonal = np.einsum("hii->hi", information)
            lifted = information + (damping[:, None] * diagonal)[..., None] * np.eye(7)
            step = np.linalg.solve(lifted, np.einsum("hri,hr->hi", jacobian, residual)[..., None])[..., 0]
            unknowns = kept - np.clip(step, -2.0, 2.0) * spread
        information = np.einsum("hri,hrj->hij", jacobian, jacobian)
        _, log_pose = np.linalg.slogdet(information)
        size = float(np.linalg.norm(wrench[:3]))
        square = np.einsum("hik,hil->hkl", white, white) * size**2 + (~sets.used)[..., None] * np.eye(SLOTS)
        _, log_force = np.linalg.slogdet(square + _RIDGE * np.eye(SLOTS))
        return SetFits(best, -0.5 * (log_pose + log_force), force, kept)


def _hole_peg(angles: Array) -> Array:
    """rotation_hole_peg (H, 3, 3) of error angles (H, 3) = (alpha, beta, gamma): the transpose of Rz Rx Ry."""
    (ca, cb, cg), (sa, sb, sg) = np.cos(angles).T, np.sin(angles).T
    rotation = np.empty((len(angles), 3, 3))
    rotation[:, 0, 0], rotation[:, 1, 0], rotation[:, 2, 0] = ca * cb - sa * sg * sb, -sa * cg, ca * sb + sa * sg * cb
    rotation[:, 0, 1], rotation[:, 1, 1], rotation[:, 2, 1] = sa * cb + ca * sg * sb, ca * cg, sa * sb - ca * sg * cb
    rotation[:, 0, 2], rotation[:, 1, 2], rotation[:, 2, 2] = -cg * sb, sg, cg * cb
    return rotation
