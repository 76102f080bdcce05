"""The same fit finds holes that are no crosses."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.config import PegDrawing, Workcell
from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.scene.camera import SimulatedScene
from services.vision.fit.rim import Rim
from services.vision.locate import locate_rim
from services.vision.stereo import StereoModel
from tests.vision.pictures.plain_look import plain_look

NOMINAL = Workcell().hole_prior.pose_base_hole()
HALF_RANGES = np.asarray(Workcell().hole_prior.half_ranges(), float)
CHI2_6_9999 = 27.86


@pytest.mark.parametrize("outline", ["square", "triangle", "hexagon", "star", "spline", "keyway", "round"])
def test_a_hole_of_another_outline_is_found(outline: str) -> None:
    cell = Workcell(peg=PegDrawing(outline=outline))
    peg = cell.peg.shape()
    hole = cell.hole.shape(peg)
    with SimulatedScene(hole, peg=peg) as scene:
        rig = scene.rig
        stereo = StereoModel.parallel(
            rig.width, rig.height, rig.fx, rig.fy, rig.cx, rig.cy, rig.baseline_m, rig.pose_base_camera
        )
        rng = np.random.default_rng(11)
        xi = rng.uniform(-0.7, 0.7, 6) * HALF_RANGES
        truth = NOMINAL @ Pose.from_rotvec(xi[3:], xi[:3])
        left, right = scene.render_stereo(truth, None, rng, appearance=plain_look(rng))
        found = locate_rim(left, right, stereo, hole, NOMINAL, HALF_RANGES)
    delta = found.pose_base_hole.inverse() @ truth
    error = np.concatenate([delta.translation_m, delta.rotvec_rad()])
    assert np.hypot(error[0], error[1]) < 0.3e-3
    assert np.hypot(error[3], error[4]) < np.deg2rad(1.5)
    assert error @ np.linalg.solve(found.covariance, error) < CHI2_6_9999
    if outline == "round":
        # nothing in the pictures tells the turn: its spread is what was known before
        assert np.sqrt(found.covariance[5, 5]) > 0.9 * HALF_RANGES[5] / np.sqrt(3.0)
    else:
        assert abs(error[5]) < np.deg2rad(0.5)


def test_the_rim_knows_what_its_outline_can_tell() -> None:
    models = {
        name: Rim.of(cell.hole.shape(cell.peg.shape()))
        for name in ("cross", "square", "round")
        for cell in [Workcell(peg=PegDrawing(outline=name))]
    }
    assert [models[name].round for name in ("cross", "square", "round")] == [False, False, True]
    # a cross has near and far edges, a square one size
    assert [float(np.ptp(models[name].reach)) for name in ("cross", "square", "round")] == [1.0, 0.0, 0.0]
    assert len(np.unique(models["cross"].facing)) == 4
    # a curve is cut into pieces that turn little, as many profiles as anywhere
    assert 10 <= models["round"].shape[0] <= 16
