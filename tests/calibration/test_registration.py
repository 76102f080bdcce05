"""Corners of boards drawn by OpenCV alone, through a lens that bends: near the truth, also on boards tilted far."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from crosspih_common.calibration.fitting import GroupedFit, Residual, fit_groups, moved_by
from crosspih_common.geometry import Pose
from services.vision.calibration.boards import Board
from services.vision.calibration.registration import register_corners
from tests.calibration.drawn_boards import PATTERN, draw, scene

SQUARES = PATTERN.corners_m()[:, :2] / PATTERN.square_m


def _tilted(tilt_rad: float, spin_rad: float, away_m: float) -> Pose:
    turn = Pose.from_rotvec([0.0, tilt_rad, 0.0], [0.0, 0.0, 0.0]) @ Pose.from_rotvec([0.0, 0.0, spin_rad], [0.0] * 3)
    middle = np.append(PATTERN.size_m / 2.0, 0.0)
    return Pose(turn.rotation, np.array([0.02, 0.01, away_m]) - turn.rotation @ middle)


@pytest.mark.parametrize(
    ("tilt_rad", "away_m", "most_px"), [(0.2, 0.22, 0.03), (0.8, 0.25, 0.05), (-1.0, 0.22, 0.08), (0.5, 0.32, 0.08)]
)
def test_corners_of_a_board_tilted_far_are_right_to_hundredths_of_a_pixel(
    tilt_rad: float, away_m: float, most_px: float
) -> None:
    of, board = scene(), Board(PATTERN)
    pose = _tilted(tilt_rad, 0.4, away_m)
    found = board.find(draw(np.random.default_rng(3), pose, of, 0, board))
    off = np.linalg.norm(found.pixels - of.cameras[0].project(pose.apply(PATTERN.corners_m()[found.ids])), axis=1)
    assert len(found) >= 20
    assert float(np.sqrt(np.mean(off**2))) < 0.6 * most_px and float(off.max()) < most_px


def test_light_that_falls_off_and_a_picture_out_of_focus_do_not_shift_them() -> None:
    of, board = scene(), Board(PATTERN)
    pose = _tilted(0.5, -0.7, 0.22)
    sharp = draw(np.random.default_rng(4), pose, of, 0, board).astype(float)
    lit = cv2.GaussianBlur(sharp, (0, 0), 1.0) * np.linspace(0.35, 1.0, sharp.shape[1])
    found = board.find(np.asarray(np.rint(lit), dtype=np.uint8))
    off = np.linalg.norm(found.pixels - of.cameras[0].project(pose.apply(PATTERN.corners_m()[found.ids])), axis=1)
    assert len(found) >= 18 and float(np.sqrt(np.mean(off**2))) < 0.06


def test_the_standard_deviation_is_told_and_a_corner_without_a_board_is_not_sound() -> None:
    of, board = scene(), Board(PATTERN)
    pose = _tilted(0.4, 0.1, 0.22)
    picture = draw(np.random.default_rng(5), pose, of, 0, board)
    true = of.cameras[0].project(pose.apply(PATTERN.corners_m()))
    found = register_corners(picture, true + np.random.default_rng(6).normal(0.0, 0.4, true.shape), SQUARES, PATTERN)
    sure = (found.pixels - true)[found.sound] / found.sd_px[found.sound, None]
    assert int(found.sound.sum()) >= 20 and 0.4 < float(np.sqrt(np.mean(sure**2))) < 2.5
    covered = picture.copy()
    x, y = np.rint(true[0]).astype(int)
    covered[y - 12 : y + 13, x - 12 : x + 13] = 128
    assert not register_corners(covered, true, SQUARES, PATTERN).sound[0]
    nothing = np.full_like(picture, 90)
    assert not register_corners(nothing, true, SQUARES, PATTERN).sound.any()


def test_corners_that_lie_on_one_line_are_not_registered() -> None:
    picture = np.full((480, 640), 90, dtype=np.uint8)
    line = np.stack([np.linspace(100.0, 300.0, len(SQUARES)), np.full(len(SQUARES), 200.0)], axis=1)
    assert not register_corners(picture, line, SQUARES, PATTERN).sound.any()


def test_what_all_groups_have_in_common_moves_a_fit_as_fitting_again_does() -> None:
    """`moved_by` against the fit itself, with an unknown of each group beside the shared ones."""
    rng = np.random.default_rng(8)
    design, group = rng.normal(size=(60, 3)), np.repeat(np.arange(6), 10)
    seen, common, slope = rng.normal(size=60), 1e-3 * rng.normal(size=60), rng.normal(size=60)
    steps, own_steps = np.full(3, 1e-6), np.array([1e-6])

    def fitted(of: np.ndarray) -> tuple[Residual, GroupedFit]:
        def residual(shared: np.ndarray, own: np.ndarray) -> np.ndarray:
            return np.asarray(of - design @ shared - slope * own[group, 0])

        return residual, fit_groups(residual, np.zeros(3), np.zeros((6, 1)), group, steps, own_steps)

    residual, before = fitted(seen)
    _, after = fitted(seen + common)
    moved = moved_by(common[:, None], residual, before, group, steps, own_steps)
    assert moved[:, 0] == pytest.approx(after.shared - before.shared, abs=1e-8)
