"""Contact samples from the mechanics, in place of the paper's simulation, for training its network."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry import rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg
from services.inference.mechanics import PairTables, contact_geometry, contact_wrench_basis, first_contacts
from services.inference.network.paper.dataset import ContactDataset

# a block of poses that fits into the processor's cache
BLOCK = 512


def pushed_until_contact(
    tables: PairTables,
    rotation_hole_peg: Array,
    translation_hole_peg_m: Array,
    direction_hole: Array,
    force_n: ArrayLike,
    friction_coefficient: ArrayLike,
    compliance_peg: Array | None = None,
) -> tuple[Array, Array]:
    """Push n pegs in a straight line to a force of force_n: (travel_m (n,), wrench (n, 6)), one contact each.

    rotation_hole_peg (n, 3, 3), translation_hole_peg_m (n, 3): start poses of the pegs in the hole frame;
    direction_hole (n, 3): unit motions. The wrench is on the peg, in the peg frame. If nothing is met, the travel is
    inf and the wrench has no meaning.
    """
    n = len(rotation_hole_peg)
    force = np.broadcast_to(np.asarray(force_n, float), (n,))
    friction = np.broadcast_to(np.asarray(friction_coefficient, float), (n,))
    travel, wrench = np.empty(n), np.empty((n, 6))
    for begin in range(0, n, BLOCK):
        part = slice(begin, begin + BLOCK)
        rotation, motion = rotation_hole_peg[part], direction_hole[part]
        pairs = first_contacts(tables, rotation, translation_hole_peg_m[part], motion)
        rows, first = np.arange(len(rotation)), pairs.travel_m.argmin(axis=1)
        travel[part] = pairs.travel_m[rows, first]
        moved = np.where(np.isfinite(travel[part]), travel[part], 0.0)[:, None] * motion
        geometry = contact_geometry(pairs.features[rows, first], rotation, translation_hole_peg_m[part] + moved)
        basis = contact_wrench_basis(
            geometry.normal_peg,
            geometry.point_peg_m,
            np.einsum("nji,nj->ni", rotation, motion),
            friction[part],
            None if compliance_peg is None else compliance_peg[part],
        )
        wrench[part] = basis * (force[part] / np.linalg.norm(basis[:, :3], axis=1))[:, None]
    return travel, wrench


def single_contact_dataset(
    peg: Peg,
    hole: Hole,
    count: int,
    rng: np.random.Generator,
    half_range_rad: float = 0.1,
    half_range_m: float = 0.005,
    force_n: float = 20.0,
    friction_coefficient: float = 0.0,
    noise_sd: tuple[float, float] = (0.0, 0.0),
    on_made: Callable[[int], None] = lambda made: None,
) -> ContactDataset:
    """`count` single contacts of a peg pushed along its own axis to a force of force_n.

    Angles (alpha, beta, gamma) uniform in +-half_range_rad, x and y of the rim uniform in +-half_range_m; z follows
    from first contact. noise_sd: of force (N) and moment (Nm). States are named after the arm that touches and the
    sense in which it is pushed (1-w2-k). Draws in which nothing touches are repeated. `on_made` is called with the
    number of contacts after every block.
    """
    tables = PairTables.of(peg, hole)
    axis = np.array([0.0, 0.0, 1.0])
    parts: list[tuple[Array, Array, Array]] = []
    left = count
    while left > 0:
        n = min(max(left, 16), BLOCK)
        angles = rng.uniform(-half_range_rad, half_range_rad, (n, 3))
        rim = np.column_stack([rng.uniform(-half_range_m, half_range_m, (n, 2)), np.full(n, peg.tip_m + 0.01)])
        to_hole = np.swapaxes(rotation_from_error_angles(angles), 1, 2)
        shift = -np.einsum("nij,nj->ni", to_hole, rim)
        travel, wrench = pushed_until_contact(tables, to_hole, shift, to_hole @ axis, force_n, friction_coefficient)
        touches = np.isfinite(travel)
        rim[:, 2] -= np.where(touches, travel, 0.0)
        keep = np.flatnonzero(touches)[:left]
        parts.append((wrench[keep], angles[keep], rim[keep]))
        left -= len(keep)
        on_made(count - left)
    wrench, angles, rim = (np.concatenate(column) for column in zip(*parts, strict=True))
    states = np.array([_state(row) for row in wrench])
    noise = rng.normal(size=wrench.shape) * np.repeat(noise_sd, 3)
    return ContactDataset(wrench + noise, angles, rim, states)


def _state(wrench: Array) -> str:
    """1-w2-k: the arm on whose side the force's line passes the axis, and the sense of its moment."""
    fx, fy = wrench[:2]
    turn = wrench[5]
    sense = 1 if turn < 0.0 else 2
    # The arm lies along the lateral force turned back by a quarter: u x f has the sign of the turn.
    lateral = np.array([fy, -fx]) * (1.0 if turn > 0.0 else -1.0)
    arm = int(np.round(np.arctan2(lateral[1], lateral[0]) / (np.pi / 2))) % 4 + 1
    return f"1-{sense}-{arm}"
