"""The seen, the found and the true pose of the hole, and the errors of the first two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import AssemblyResult, SimulationTruth
from services.operator.scoring.score import PoseError, pose_error


@dataclass(frozen=True, slots=True, eq=False)
class HolePose:
    """One pose of the hole in the base frame. `error` is against the truth, and `off` the same axis by axis (x, y, z in
    mm, rotation vector in degrees, in the true hole's frame). Both are None where there is no truth, or the pose is the
    truth.
    """

    name: str
    pose: Pose
    error: PoseError | None
    off: tuple[float, ...] | None


def poses_of(workcell: Workcell, result: AssemblyResult | None, truth: SimulationTruth | None) -> list[HolePose]:
    """T1 as the cameras saw it, T2 as found (or as last believed), and the truth; unknown poses are left out."""
    believed = "as found (T2)" if result is not None and result.inserted else "as last believed"
    said = [
        ("as seen (T1)", result.vision_pose_base_hole if result else None),
        (believed, result.pose_base_hole if result else None),
    ]
    order = workcell.peg.shape().outline.symmetry_order
    true_hole = None if truth is None else truth.pose_base_hole.pose()
    found = []
    for name, data in said:
        if data is None:
            continue
        pose = data.pose()
        error = None if true_hole is None else pose_error(pose, true_hole, order)
        found.append(HolePose(name, pose, error, None if true_hole is None else _off(pose, true_hole, order)))
    if true_hole is not None:
        found.append(HolePose("as it is (truth)", true_hole, None, None))
    return found


def reference_hole(workcell: Workcell, result: AssemblyResult | None) -> tuple[Pose, str]:
    """The cell's own best pose of the hole, used as frame for the tip's path; and its name in words."""
    if result is not None and result.pose_base_hole is not None:
        known = "the hole as found in the end (T2)" if result.inserted else "the hole as last believed"
        return result.pose_base_hole.pose(), known
    if result is not None and result.vision_pose_base_hole is not None:
        return result.vision_pose_base_hole.pose(), "the hole as the cameras saw it (T1)"
    return workcell.hole_prior.pose_base_hole(), "the hole as drawn: nothing else was known of it"


def _off(pose: Pose, true_hole: Pose, symmetry_order: int) -> tuple[float, ...]:
    """In the true hole's frame, up to the rotations that map the section onto itself."""
    error = true_hole.inverse() @ pose
    if symmetry_order == 0:
        turned_by = np.arctan2(error.rotation[1, 0] - error.rotation[0, 1], error.rotation[0, 0] + error.rotation[1, 1])
        turns = np.array([-turned_by])
    else:
        turns = np.arange(symmetry_order) * (2.0 * np.pi / symmetry_order)
    candidates = Rotation.from_matrix(error.rotation) * Rotation.from_euler("z", turns[:, None])
    turned = candidates[int(np.argmin(candidates.magnitude()))].as_rotvec(degrees=True)
    return (*(error.translation_m * 1e3).tolist(), *turned.tolist())
