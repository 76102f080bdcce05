"""Stereo and eye-to-hand from corners and from pictures whose answer is known."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from typer.testing import CliRunner

from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.keys import CAPTURE, IMAGE_LEFT, IMAGE_RIGHT
from crosspih_common.messages import CameraCalibration, Image, StereoPair
from services.operator.cli.commands import app
from services.vision.calibration.boards import Board
from services.vision.calibration.coverage import missing_parts, missing_poses, parts_seen
from services.vision.calibration.hand_eye import CameraDoubt, calibrate_hand_eye, missing_turns, park_martin
from services.vision.calibration.pairs import vector_of
from services.vision.calibration.stereo import calibrate_stereo
from tests.calibration.drawn_boards import PATTERN, SIZE, Scene, board_poses, corners, draw, flanges, scene
from tests.calibration.recordings import Said, recording_of

SIZES = (SIZE, SIZE)
FULL = "k1 k2 p1 p2"


def _found(of: Scene, seed: int, count: int = 12) -> tuple[object, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    poses = board_poses(rng, count, of)
    pairs = corners(rng, poses, of, 0.04)
    stereo = calibrate_stereo(pairs, PATTERN, SIZES, FULL, 2)
    rig = stereo.rig
    doubt = CameraDoubt(rig, stereo.fit.shared, stereo.fit.covariance)
    eye = calibrate_hand_eye(
        pairs, flanges(poses, of), PATTERN, rig.cameras(stereo.fit.shared), rig.right(stereo.fit.shared), 2, doubt
    )
    true = np.concatenate([*([c.fx_px, c.fy_px, c.cx_px, c.cy_px, *c.distortion[:4]] for c in of.cameras),
                           vector_of(of.pose_left_right)])  # fmt: skip
    astray = vector_of(of.pose_base_camera.inverse() @ eye.pose_base_camera)
    return eye, (stereo.fit.shared - true) / stereo.fit.half_width(), astray / eye.fit.half_width()[:6]


def test_the_intervals_of_stereo_and_of_the_eye_hold() -> None:
    of = scene()
    found = [_found(of, seed) for seed in range(3)]
    assert np.mean([np.abs(one[1]) <= 1.0 for one in found]) >= 0.88
    assert np.mean([np.abs(one[2]) <= 1.0 for one in found]) >= 0.8


def test_the_size_of_the_distortion_is_chosen_by_pairs_left_out() -> None:
    rng = np.random.default_rng(2)
    straight = scene((0.0,))
    poses = board_poses(rng, 7, straight)
    few = calibrate_stereo(corners(rng, poses, straight, 0.03), PATTERN, SIZES, None, 2)
    assert few.model in ("none", "k1") and "k1 k2 p1 p2 k3" not in few.held_out_px
    bent = scene()
    chosen = calibrate_stereo(corners(rng, board_poses(rng, 10, bent), bent, 0.03), PATTERN, SIZES, None, 2)
    assert chosen.model == FULL
    assert chosen.held_out_px["none"] > 5.0 * chosen.held_out_px[FULL]


def test_one_fit_of_both_cameras_agrees_with_opencv() -> None:
    rng, of = np.random.default_rng(5), scene()
    pairs = corners(rng, board_poses(rng, 8, of), of, 0.02)
    fit = calibrate_stereo(pairs, PATTERN, SIZES, FULL, 2)
    both = [np.intersect1d(left.ids, right.ids) for left, right in pairs]
    objects = [PATTERN.corners_m()[ids].astype(np.float32) for ids in both]
    pixels = [
        [
            side.pixels[np.isin(side.ids, ids)].astype(np.float32).reshape(-1, 1, 2)
            for side, ids in zip(one, both, strict=True)
        ]
        for one in zip(*pairs, strict=True)
    ]
    (left, bent_left), (right_matrix, bent_right) = (
        (
            np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]]),
            np.array([*camera.distortion[:4], 0.0]),
        )
        for camera in fit.rig.cameras(fit.fit.shared)
    )
    done = cv2.stereoCalibrate(
        objects,
        pixels[0],
        pixels[1],
        left,
        bent_left,
        right_matrix,
        bent_right,
        SIZE,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3,
    )
    to_right = Pose(np.asarray(done[5], float), np.asarray(done[6], float).ravel())
    right = fit.rig.right(fit.fit.shared)
    assert to_right.inverse().distance_to_m(right) < 5e-5
    assert to_right.inverse().angle_to_rad(right) < 5e-4
    assert float(done[1][0, 0]) == pytest.approx(fit.fit.shared[0], abs=0.3)


def test_pictures_drawn_by_opencv_alone_are_measured_to_a_tenth_of_a_millimetre() -> None:
    rng, of, board = np.random.default_rng(1), scene(), Board(PATTERN)
    poses = board_poses(rng, 8, of, 0.5)
    pairs = [tuple(board.find(draw(rng, pose, of, side, board)) for side in (0, 1)) for pose in poses]
    for pose, (left, _) in zip(poses, pairs, strict=True):
        off = left.pixels - of.cameras[0].project(pose.apply(PATTERN.corners_m()[left.ids]))
        assert len(left) >= 12 and float(np.sqrt(np.mean(off**2))) < 0.1
    eye = calibrate_hand_eye(pairs, flanges(poses, of), PATTERN, of.cameras, of.pose_left_right, 3)  # type: ignore[arg-type]
    astray = of.pose_base_camera.inverse() @ eye.pose_base_camera
    assert float(np.linalg.norm(astray.translation_m)) < 3e-4
    assert float(np.linalg.norm(astray.rotvec_rad())) < np.deg2rad(0.1)


def test_park_and_martin_is_exact_without_noise() -> None:
    of = scene()
    poses = board_poses(np.random.default_rng(0), 5, of)
    camera, board = park_martin(flanges(poses, of), poses)
    assert camera.distance_to_m(of.pose_base_camera) < 1e-9 and camera.angle_to_rad(of.pose_base_camera) < 1e-7
    assert board.distance_to_m(of.pose_flange_board) < 1e-9


def test_what_fixes_nothing_is_refused_with_the_pictures_that_are_missing() -> None:
    rng, of = np.random.default_rng(0), scene()
    poses = board_poses(rng, 8, of)
    pairs = corners(rng, poses, of, 0.03)
    with pytest.raises(CalibrationRefused, match="3 pairs show the board, want 5"):
        calibrate_stereo(pairs[:3], PATTERN, SIZES)
    flat = board_poses(rng, 8, of, 0.01)
    with pytest.raises(CalibrationRefused, match="tilted nearly the same"):
        calibrate_stereo(corners(rng, flat, of, 0.03), PATTERN, SIZES)
    with pytest.raises(CalibrationRefused, match="4 poses show the board"):
        calibrate_hand_eye(pairs[:4], flanges(poses, of)[:4], PATTERN, of.cameras, of.pose_left_right)
    # an arm that turned about one axis alone
    start = flanges(poses, of)[0]
    about = [start @ Pose.from_rotvec([0.0, 0.0, 0.1 * index], [0.001 * index, 0.0, 0.0]) for index in range(8)]
    with pytest.raises(CalibrationRefused, match="about one axis only"):
        calibrate_hand_eye(pairs, about, PATTERN, of.cameras, of.pose_left_right)
    assert "turn it about that axis as well" in " ".join(missing_turns(about))


def test_advice_names_the_part_the_tilt_and_the_distance_that_are_missing() -> None:
    rng, of = np.random.default_rng(0), scene()
    square = Pose.from_translation([-0.06, -0.04, 0.25])
    said = missing_poses([square] * 8, PATTERN)
    assert any("right edge away" in line for line in said) and any("nearer or farther" in line for line in said)
    parts = parts_seen(corners(rng, [square], of, 0.0), SIZES)
    assert "upper left" in missing_parts(parts)[0]
    many = board_poses(rng, 30, of)
    assert not missing_poses(many, PATTERN)


def test_a_pattern_that_cannot_be_is_refused_with_how_it_is_written() -> None:
    assert str(BoardPattern.of("9x6:0.02:0.015:DICT_4X4_50")) == "9x6:0.02:0.015:DICT_4X4_50"
    for text, said in (
        ("9x6", "write squares across"), ("9x6:20:15:DICT_4X4_50", "metres"),
        ("9x6:0.02:0.03:DICT_4X4_50", "does not fit"),
        ("2x6:0.02:0.01:DICT_4X4_50", "3 to 40"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            BoardPattern.of(text)


def test_the_printed_board_is_in_true_size_and_is_found_again(tmp_path: Path) -> None:
    runner = CliRunner()
    for name in ("board.pdf", "board.png"):
        done = runner.invoke(app, ["calibrate", "board", str(tmp_path / name), "--board", str(PATTERN)])
        assert done.exit_code == 0, done.output
    page = (tmp_path / "board.pdf").read_bytes()
    rectangles = [line.split() for line in page.decode("latin1").splitlines() if line.endswith(" re")]
    black = [one for one in rectangles if abs(float(one[2]) - 0.018 / 0.0254 * 72.0) < 1e-3]
    assert len(black) == 18 and page.startswith(b"%PDF-1.4") and page.rstrip().endswith(b"%%EOF")
    picture = cv2.imread(str(tmp_path / "board.png"), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    found = Board(PATTERN).find(np.asarray(picture, dtype=np.uint8))
    assert len(found) == PATTERN.count
    spacing = np.diff(found.pixels[: PATTERN.columns - 1, 0])
    assert spacing == pytest.approx(0.018 * 11811.0, abs=1.0)


def _read(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), dtype=np.uint8)


def leaves_of(told: Any, path: str = "") -> dict[str, Any]:
    """Every leaf of a JSON object by its path."""
    if isinstance(told, dict | list):
        parts = told.items() if isinstance(told, dict) else enumerate(told)
        return {name: leaf for key, part in parts for name, leaf in leaves_of(part, f"{path}/{key}").items()}
    return {path: told}


def test_pictures_from_files_to_the_cameras_file_that_locate_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CROSSPIH_RUN_DIR", str(tmp_path / "run"))
    rng, of, board = np.random.default_rng(4), scene(), Board(PATTERN)
    folder = tmp_path / "photos"
    folder.mkdir()
    for number, pose in enumerate(board_poses(rng, 8, of, 0.6)):
        for side, name in enumerate(("left", "right")):
            cv2.imwrite(str(folder / f"{name}-{number}.png"), draw(rng, pose, of, side, board))
    out = tmp_path / "cameras.yaml"
    words = [sys.executable, "-m", "services.operator", "calibrate", "stereo", "--from", str(folder), "--board",
             str(PATTERN), "--model", FULL, "--cameras", str(out), "--json"]  # fmt: skip
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["pairs"] == 8 and said["rms_px"] < 0.2 and said["held_out_mm"] < 0.2
    content = yaml.safe_load(out.read_text())
    told = CameraCalibration.model_validate({**content, "pose_base_camera": content.get("pose_base_camera") or {
        "position_m": (0.0, 0.0, 0.0), "quaternion_xyzw": (0.0, 0.0, 0.0, 1.0)}})  # fmt: skip
    assert told.left.fx_px == pytest.approx(381.36, abs=4.0)
    assert told.pose_left_right.pose().distance_to_m(of.pose_left_right) < 1e-3
    # the same pictures in a recording
    stamps = range(100, 900, 100)
    pictures = [
        [Image(frame=name, pixels=_read(folder / f"{name}-{number}.png")) for name in ("left", "right")]
        for number in range(8)
    ]  # fmt: skip
    message = CameraCalibration.model_validate({**content, "pose_base_camera": told.pose_base_camera})
    recording = recording_of(
        tmp_path,
        [
            said
            for at_ms, (left, right) in zip(stamps, pictures, strict=True)
            for said in (
                Said(IMAGE_LEFT, left, at_ms), Said(IMAGE_RIGHT, right, at_ms),
                Said(CAPTURE.reply_echo, StereoPair(capture_id=1, exposure_s=0.01, calibration=message), at_ms),
            )
        ],
    )  # fmt: skip
    words[6] = str(recording)
    again = subprocess.run(words, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    of_a_run = {"found", "taken_at"}
    then, now = ({name: value for name, value in one.items() if name not in of_a_run}
                 for one in (said, json.loads(again.stdout)))  # fmt: skip
    # the fit's sums are shared out to threads, and not in the same order each time
    here, there = leaves_of(now), leaves_of(then)
    assert here.keys() == there.keys()
    for path, value in here.items():
        assert value == (pytest.approx(there[path], rel=1e-4, abs=1e-7) if isinstance(value, float) else there[path])
    # pictures without their partners
    (folder / "right-0.png").unlink()
    words[6] = str(folder)
    lost = subprocess.run(words, capture_output=True, text=True, check=False)
    assert lost.returncode == 1 and "8 pictures have `left`" in " ".join(lost.stderr.split())
