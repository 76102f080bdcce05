"""The hole in pictures of the default cell as they are: any finish, light and background, through its own lenses."""

from __future__ import annotations

import numpy as np

from crosspih_common.config import load_cell
from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.scene.camera import SimulatedScene
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.vision.locate import locate_rim
from services.vision.refusals import VisionRefusal
from tests.vision.pictures.test_looks import stereo_of

CELL = load_cell("deploy/cells/default.yaml").workcell
HOLE = CELL.hole.shape(CELL.peg.shape())
NOMINAL = CELL.hole_prior.pose_base_hole()
HALF_RANGES = np.asarray(CELL.hole_prior.half_ranges(), float)
CHI2_6_9999 = 27.86


def test_drawn_looks_are_found_or_refused_and_never_sure_and_wrong() -> None:
    rig = StereoRig.of(CELL.camera)
    stereo, lateral_m = stereo_of(rig), []
    with SimulatedScene(HOLE, rig) as scene:
        for seed in range(3000, 3010):
            rng = np.random.default_rng(seed)
            xi = rng.uniform(-1.0, 1.0, 6) * HALF_RANGES
            truth = NOMINAL @ Pose.from_rotvec(xi[3:], xi[:3])
            left, right = scene.render_stereo(truth, None, rng)
            try:
                found = locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)
            except VisionRefusal:
                continue
            delta = found.pose_base_hole.inverse() @ truth
            error = np.concatenate([delta.translation_m, delta.rotvec_rad()])
            assert error @ np.linalg.solve(found.covariance, error) < CHI2_6_9999, seed
            lateral_m.append(float(np.hypot(*error[:2])))
    assert len(lateral_m) >= 9
    assert np.median(lateral_m) < 0.15e-3
