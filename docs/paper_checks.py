"""Checks of the paper's own numbers against one another, as docs/paper-claims.md cites them. From the project's root:

.venv/bin/python docs/paper_checks.py
"""

from __future__ import annotations

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from services.force_torque.contact_table import STATES
from services.inference.mechanics import PairTables, axial_share
from services.inference.mechanics.contact_wrench import equal_arms_axial_share
from services.inference.network.paper.paper_rows import paper_rows
from services.inference.network.paper.synthesis import pushed_until_contact

# the pose found in the end, and the one where the hole was put (Section 5 and Eq. 13, signs restored)
T2 = np.array(
    [[-0.0690, 0.0745, 0.9948, 0.4365], [-0.0594, -0.9957, 0.0704, -0.3139], [0.9959, -0.0542, 0.0731, 0.2042]]
)
T0 = np.array([[-0.07, 0.06, 1.0, 0.4], [-0.06, -1.0, 0.06, -0.3], [1.0, -0.06, 0.07, 0.2]])
# (row, column, value) of Table 6 as printed where it is taken for a misprint
MISPRINTS = ((3, 5, 0.266), (4, 5, 0.481), (6, 3, 0.101))
STEP = 1e-6


def pitch_mm(wrench: Array) -> Array:
    """F.M / |F|^2 of wrenches (n, 6): zero for one force through one point, whatever its line."""
    force, moment = wrench[:, :3], wrench[:, 3:]
    return np.asarray(np.einsum("ni,ni->n", force, moment) / np.einsum("ni,ni->n", force, force) * 1e3)


def singular_values(poses: int, seed: int) -> Array:
    """Of the map from (alpha, beta, gamma, x, y) to a single contact's wrench, at random poses: (n, 5), falling."""
    rng = np.random.default_rng(seed)
    cell = Workcell()
    peg = cell.peg.shape()
    tables = PairTables.of(peg, cell.hole.shape(peg))
    centre = np.column_stack([rng.uniform(-0.1, 0.1, (poses, 3)), rng.uniform(-0.002, 0.002, (poses, 2))])

    def wrench(parameters: Array) -> Array:
        n = len(parameters)
        to_hole = np.swapaxes(rotation_from_error_angles(parameters[:, :3]), 1, 2)
        rim = np.column_stack([parameters[:, 3:], np.full(n, peg.tip_m + 0.01)])
        start = -np.einsum("nij,nj->ni", to_hole, rim)
        _, felt = pushed_until_contact(tables, to_hole, start, to_hole[:, :, 2], 1.0, 0.0)
        # moments over a lever of 50 mm, so that all six numbers are of one kind
        return np.asarray(felt * np.array([1.0, 1.0, 1.0, 20.0, 20.0, 20.0]))

    # metres in units of 50 mm, for the same reason
    steps = [STEP * unit * scale for unit, scale in zip(np.eye(5), (1.0, 1.0, 1.0, 0.05, 0.05), strict=True)]
    columns = [(wrench(centre + step) - wrench(centre - step)) / (2.0 * STEP) for step in steps]
    return np.asarray(np.linalg.svd(np.stack(columns, axis=2), compute_uv=False))


def main() -> None:
    """Print each check on a line."""
    rows = paper_rows()
    printed = rows.wrench.copy()
    for row, column, value in MISPRINTS:
        printed[row, column] = value
    before, after = np.abs(pitch_mm(printed)), np.abs(pitch_mm(rows.wrench))
    wrong = ", ".join(str(row + 1) for row in np.flatnonzero(before > 0.1))
    print(f"Table 6, pitch of the wrench: as printed rows {wrong} have {before.max():.1f} mm at most,")
    print(f"  with three numbers mended all ten have {after.max():.3f} mm at most: each is one force through one point")

    values = singular_values(400, 1)
    share = np.mean(values[:, 2] < 1e-4 * values[:, 0])
    print(f"one contact's wrench: {share * 100:.1f} % of 400 random single contacts have rank 2 in the five unknowns;")
    print(f"  third singular value over the first: median {np.median(values[:, 2] / values[:, 0]):.0e}")

    spread = rows.angles_rad.var(axis=0).mean()
    print(f"Table 7, guessing the mean: {spread:.1e} rad^2 mean square error; the training goal is 1e-3")

    ratio = np.abs(rows.wrench[:, 2]) / np.linalg.norm(rows.wrench[:, :2], axis=1)
    shares = [float(np.mean(equal_arms_axial_share(ratio, arms))) for arms in (1, 2, 3, 4)]
    measured = axial_share(rows.wrench[:, :3])
    print(f"n_z0 of Table 6's contacts: {measured.min():.3f} to {measured.max():.3f}; of 1, 2, 3, 4 such arms pressing")
    print("  equally: " + ", ".join(f"{value:.3f}" for value in shares) + " (paper: 0.278, 0.376, 0.649, 1)")

    patterns = len({state.signs for state in STATES})
    print(f"Tables 2-5: {len(STATES)} states have {patterns} different patterns of signs")

    axis = T0[:, 2] / np.linalg.norm(T0[:, 2])
    apart = T2[:, 3] - T0[:, 3]
    along = float(apart @ axis)
    turned = np.degrees(np.arccos(np.clip(T2[:, 2] @ axis / np.linalg.norm(T2[:, 2]), -1.0, 1.0)))
    across = float(np.linalg.norm(apart - along * axis))
    print(f"T2 against T0: {along * 1e3:.1f} mm along the hole, {across * 1e3:.1f} mm across it,")
    print(f"  axes {turned:.2f} deg apart")


if __name__ == "__main__":
    main()
