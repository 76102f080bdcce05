"""Touches made by the mechanics alone: the peg pushed to a given force at the first contact, wrist deflection
included."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.inference.estimator import TouchObservation
from services.inference.mechanics import PairTables, contact_geometry, contact_wrench_basis, first_contacts

COMPLIANCE = np.diag([1e-5] * 3 + [1e-3] * 3)
READING_SD = np.repeat([0.02, 0.001], 3)


def synthetic_touch(
    tables: PairTables,
    pose_base_hole: Pose,
    start_base_peg: Pose,
    direction_base: Array,
    friction_coefficient: float,
    rng: np.random.Generator,
    force_n: float = 20.0,
    noise: float = 1.0,
) -> TouchObservation:
    """The observation of a push with one contact; noise: in sds of the readings."""
    to_hole = pose_base_hole.inverse()
    pose = to_hole @ start_base_peg
    direction = to_hole.rotate(direction_base)
    pairs = first_contacts(tables, pose.rotation[None], pose.translation_m[None], direction[None])
    first = int(pairs.travel_m[0].argmin())
    touching = Pose(pose.rotation, pose.translation_m + pairs.travel_m[0, first] * direction)
    geometry = contact_geometry(pairs.features[0, first], touching.rotation, touching.translation_m)
    basis = contact_wrench_basis(
        geometry.normal_peg, geometry.point_peg_m, touching.rotation.T @ direction, friction_coefficient, COMPLIANCE
    )
    wrench = basis * force_n / np.linalg.norm(basis[:3])
    measured = wrench + noise * rng.normal(size=6) * READING_SD
    # The motor-side pose is the touching one with the deflection taken back.
    twist = COMPLIANCE @ wrench
    commanded = touching @ Pose.from_rotvec(twist[3:], twist[:3]).inverse()
    return TouchObservation(pose_base_hole @ commanded, measured, READING_SD, COMPLIANCE, direction_base)
