"""Contact forces of a peg on a compliant wrist: f >= 0, gap >= 0, f gap = 0, with Coulomb friction.

One step of Stewart and Trinkle's implicit scheme (Int. J. Numer. Meth. Eng. 39, 1996), without inertia: the wrist's
compliance takes the place of the inverse mass. Solved contact by contact (nonlinear block Gauss-Seidel; Jourdan, Alart,
Jean 1998), with the exact friction disc instead of a polygon, for many pushes at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class ContactForces:
    """forces_n (N, M, 3): along each contact's normal and two tangents; residual_n (N,): largest change of a force in
    the last sweep; sweeps (N,)."""

    forces_n: Array
    residual_n: Array
    sweeps: NDArray[np.int64]


def contact_forces(
    delassus: Array,
    free: Array,
    friction: Array,
    start: Array,
    sweeps: int = 300,
    tolerance_n: float = 1e-6,
) -> ContactForces:
    """Forces f (N, M, 3) so that u = free + delassus f obeys, for every contact: 0 <= f_n, 0 <= u_n, f_n u_n = 0, and
    f_t = -friction f_n u_t / |u_t| where it slides, |f_t| <= friction f_n where u_t = 0.

    delassus (N, M, 3, M, 3): displacement (m) of contact points along normal and tangents per force (1 N) on them; free
    (N, M, 3): gap (m) and slip (m) that would remain without contact forces; a contact that does not exist has free =
    (inf, 0, 0). friction (N,). start (N, M, 3): a guess. Stops when no force changes by more than
    the tolerance (N).
    """
    n, m = free.shape[:2]
    forces = np.where(np.isfinite(free[..., :1]), start, 0.0)
    free = np.where(np.isfinite(free), free, 1e3)
    own = np.einsum("nmimj->nmij", delassus)
    normal = np.maximum(own[..., 0, 0], 1e-15)
    # The larger eigenvalue of the tangential block, by its bound, so that steps along the slip never overshoot.
    tangential = np.maximum(own[..., 1, 1] + own[..., 2, 2], 1e-15)
    rows = delassus.reshape(n, m, 3, 3 * m)
    residual, used = np.zeros(n), np.zeros(n, dtype=np.int64)
    left = np.arange(n)
    for sweep in range(sweeps):
        changed = np.zeros(len(left))
        mine = forces[left]
        for contact in range(m):
            before = mine[:, contact].copy()
            moved = free[left, contact] + _times(rows[left, contact], mine)
            f_n = np.maximum(before[:, 0] - moved[:, 0] / normal[left, contact], 0.0)
            # A change of the normal force moves the point sideways as well.
            slip = moved[:, 1:] + own[left, contact, 1:, 0] * (f_n - before[:, 0])[:, None]
            f_t = before[:, 1:] - slip / tangential[left, contact, None]
            most = friction[left] * f_n
            f_t *= np.minimum(1.0, most / np.maximum(np.linalg.norm(f_t, axis=1), 1e-300))[:, None]
            mine[:, contact, 0], mine[:, contact, 1:] = f_n, f_t
            changed = np.maximum(changed, np.abs(mine[:, contact] - before).max(axis=1))
        forces[left], residual[left], used[left] = mine, changed, sweep + 1
        left = left[changed > tolerance_n]
        if len(left) == 0:
            break
    return ContactForces(forces, residual, used)


def _times(rows: Array, forces: Array) -> Array:
    """Products (N, 3) of rows (N, 3, 3 M) with forces (N, M, 3)."""
    return np.asarray((rows @ forces.reshape(len(forces), rows.shape[2], 1))[..., 0])
