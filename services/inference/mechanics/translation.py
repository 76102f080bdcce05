"""The paper's last step: with the three angles known, x and y (and z by the travel) from one contact (Eq. 24)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from crosspih_common.geometry import rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from services.inference.mechanics.contact_wrench import contact_wrench_basis
from services.inference.mechanics.features import contact_geometry
from services.inference.mechanics.first_contact import first_contacts
from services.inference.mechanics.pairs import PairTables

FORCE_SCALE_N = 0.2
MOMENT_SCALE_NM = 0.01


def solve_translation(
    tables: PairTables,
    angles_rad: Array,
    wrench_peg: Array,
    rim_ahead_m: float,
    friction_coefficient: float = 0.0,
    reach_m: float = 0.006,
) -> tuple[Array, float]:
    """Translation (3,) of the hole's rim in the peg frame, m, that explains a single contact's wrench; and its cost.

    angles_rad (3,): alpha, beta, gamma of the hole in the peg frame. wrench_peg (6,). rim_ahead_m: the believed place
    of the rim along z. The peg is pushed along its own axis; for each (x, y) first contact gives z, the contact point
    and the direction of its force, and least squares over x and y fits the wrench. Starts on a grid of +-reach_m.
    The cost is the sum of squares in units of 0.2 N and 0.01 Nm.
    """
    rotation_peg_hole = rotation_from_error_angles(angles_rad)
    to_hole = rotation_peg_hole.T
    wrench = np.asarray(wrench_peg, float)
    scale = np.repeat([FORCE_SCALE_N, MOMENT_SCALE_NM], 3)
    axis = np.array([0.0, 0.0, 1.0])

    def contact(xy: Array) -> tuple[Array, Array]:
        """Residuals (n, 6) and z (n,) for rim positions (n, 2)."""
        n = len(xy)
        rim = np.column_stack([xy, np.full(n, rim_ahead_m)])
        rotation = np.repeat(to_hole[None], n, axis=0)
        shift = -rim @ to_hole.T
        pairs = first_contacts(tables, rotation, shift, np.repeat((to_hole @ axis)[None], n, axis=0))
        first = pairs.travel_m.argmin(axis=1)
        travel = np.where(np.isfinite(pairs.travel_m.min(axis=1)), pairs.travel_m.min(axis=1), 0.0)
        rows = np.arange(n)
        shift = shift + travel[:, None] * (to_hole @ axis)
        geometry = contact_geometry(pairs.features[rows, first], rotation, shift)
        basis = contact_wrench_basis(
            geometry.normal_peg, geometry.point_peg_m, np.broadcast_to(axis, (n, 3)), friction_coefficient
        )
        white = basis / scale
        target = wrench / scale
        force = np.maximum(white @ target / np.einsum("ni,ni->n", white, white), 0.0)
        return target - force[:, None] * white, rim_ahead_m - travel

    def residual(xy: Array) -> Array:
        return np.asarray(contact(xy[None])[0][0])

    side = np.linspace(-reach_m, reach_m, 25)
    grid = np.array(np.meshgrid(side, side)).reshape(2, -1).T
    costs = np.sum(contact(grid)[0] ** 2, axis=1)
    best: tuple[float, Array] = (np.inf, grid[0])
    for start in np.argsort(costs, kind="stable")[:4]:
        fit = least_squares(residual, grid[start], x_scale=1e-3, method="lm")
        if 2.0 * fit.cost < best[0]:
            best = (2.0 * float(fit.cost), np.asarray(fit.x))
    z = float(contact(best[1][None])[1][0])
    return np.array([*best[1], z]), best[0]
