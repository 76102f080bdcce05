"""The two renderers: the same pictures, and the same hole found in them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.scene.camera import SimulatedScene
from services.hardware.drivers.simulated.scene.numpy_renderer import NumpyRenderer
from services.hardware.drivers.simulated.scene.renderer import View
from services.hardware.drivers.simulated.scene.scene_appearance import Faults
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh, box_mesh
from services.vision.locate import locate_rim
from services.vision.stereo import StereoModel
from tests.vision.pictures.plain_look import plain_look

WORKCELL = Workcell()
HOLE = WORKCELL.hole.shape(WORKCELL.peg.shape())
NOMINAL = WORKCELL.hole_prior.pose_base_hole()
HALF_RANGES = np.asarray(WORKCELL.hole_prior.half_ranges(), float)
HOME = np.asarray(WORKCELL.home_joints_rad)
# an eye at the base's origin that looks along -z, with y upwards: OpenGL's own frame
AHEAD = np.eye(4).ravel().tolist()


def lens(near_m: float, far_m: float) -> list[float]:
    """A quarter turn of view across and down."""
    matrix = np.diag([1.0, 1.0, -(far_m + near_m) / (far_m - near_m), 0.0])
    matrix[2, 3], matrix[3, 2] = -2.0 * far_m * near_m / (far_m - near_m), -1.0
    return [float(value) for value in matrix.T.ravel()]


def seen_from(renderer: NumpyRenderer, size: int = 200) -> View:
    return View(size, size, AHEAD, lens(0.1, 10.0), np.array([0.0, 0.0, 1.0]), 0.2, 0.6)


@pytest.fixture(scope="module")
def pair() -> Iterator[tuple[SimulatedScene, SimulatedScene]]:
    tiny = pytest.importorskip("services.hardware.drivers.simulated.scene.tiny_renderer", exc_type=ImportError)
    with (
        SimulatedScene(HOLE, renderer=tiny.TinyRenderer()) as one,
        SimulatedScene(HOLE, renderer=NumpyRenderer()) as other,
    ):
        yield one, other


@pytest.mark.parametrize("faults", [Faults(), Faults(covered_arm=2, square=True, second_cross=True, light_scale=0.5)])
def test_both_draw_the_same(pair: tuple[SimulatedScene, SimulatedScene], faults: Faults) -> None:
    for seed, joints in ((0, None), (1, HOME)):
        one, other = (scene.render_stereo(NOMINAL, joints, np.random.default_rng(seed), faults) for scene in pair)
        difference = np.abs(np.subtract(one, other, dtype=int))
        # single samples on edges
        assert np.count_nonzero(difference) < 30 and difference.max() < 10


def test_the_hole_is_found_alike(pair: tuple[SimulatedScene, SimulatedScene]) -> None:
    rig = pair[0].rig
    stereo = StereoModel.parallel(
        rig.width, rig.height, rig.fx, rig.fy, rig.cx, rig.cy, rig.baseline_m, rig.pose_base_camera
    )
    for seed in range(3):
        offset = np.random.default_rng(seed).uniform(-HALF_RANGES, HALF_RANGES)
        truth = NOMINAL @ Pose.from_rotvec(offset[3:], offset[:3])
        found = []
        for scene in pair:
            rng = np.random.default_rng(seed)
            left, right = scene.render_stereo(truth, None, rng, appearance=plain_look(rng))
            found.append(locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES).pose_base_hole)
        assert found[0].distance_to_m(found[1]) < 2e-6
        assert np.linalg.norm((found[0].inverse() @ found[1]).rotvec_rad()) < 1e-4


def test_a_plate_covers_what_geometry_says_and_is_lit_by_the_cosine() -> None:
    renderer = NumpyRenderer()
    body = renderer.add(box_mesh((0.5, 0.25, 0.05)))
    renderer.colour(body, (1.0, 0.5, 0.0))
    renderer.place(body, Pose.from_translation([0.0, 0.0, -2.05]))
    drawn = renderer.draw(seen_from(renderer))
    # the face at 2 m: half of 200 pixels for 2 m to either side
    covered = ~drawn.empty
    assert np.count_nonzero(covered) == pytest.approx(50 * 25, rel=0.03)
    rows, columns = np.nonzero(covered)
    assert 74 <= columns.min() <= 76 and 124 <= columns.max() <= 126 and 86 <= rows.min() <= 88
    assert np.unique(drawn.rgb[covered], axis=0).tolist() == [[204, 101, 0]]


def test_the_nearer_of_two_hides_the_farther_whatever_came_first() -> None:
    for order in ((-2.0, -3.0), (-3.0, -2.0)):
        renderer = NumpyRenderer()
        for z_m in order:
            body = renderer.add(box_mesh((0.3, 0.3, 0.1)))
            renderer.place(body, Pose.from_translation([0.0, 0.0, z_m]))
            renderer.colour(body, (1.0, 1.0, 1.0) if z_m == -2.0 else (0.5, 0.5, 0.5))
        assert renderer.draw(seen_from(renderer)).rgb[100, 100, 0] == 204


def test_what_reaches_behind_the_eye_is_cut_and_what_is_behind_is_not_drawn() -> None:
    """A floor under the eye, from behind it to far ahead: it fills the lower part up to its far edge."""
    corners = np.array([[-50.0, -1.0, 5.0], [50.0, -1.0, 5.0], [50.0, -1.0, -8.0], [-50.0, -1.0, -8.0]])
    floor = RenderMesh(corners, np.tile([0.0, 1.0, 0.0], (4, 1)), [0, 1, 2, 0, 2, 3])
    renderer = NumpyRenderer()
    renderer.add(floor)
    renderer.place(renderer.add(box_mesh((1.0, 1.0, 1.0))), Pose.from_translation([0.0, 0.0, 5.0]))
    drawn = renderer.draw(seen_from(renderer))
    horizon = 100 + 100 / 8
    assert np.all(drawn.empty[: int(horizon) - 1])
    assert not np.any(drawn.empty[int(horizon) + 1 :])
