"""Vision without a bus: jobs by lines, pictures from files of any kind, cameras of any kind."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from crosspih_common.config import CameraSection, Workcell, load_cell
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, CameraModel, DistortionModel, Gamma, LocateMethod
from services.vision import offline
from services.vision.locate import Located
from services.vision.offline import serve
from services.vision.refusals import NoCross, VisionRefusal
from tests.vision.pictures.lenses import OWN, calibration_of, fine_pair, seen_by

NOMINAL = Workcell().hole_prior.pose_base_hole()
TRUTH = NOMINAL @ Pose.from_rotvec([0.05, -0.04, 0.06], [0.004, -0.003, 0.006])
STILL = Pose.identity()
CELL = "deploy/cells/default.yaml"
PINHOLE = CameraModel(**{
    name: getattr(CameraSection(), name) for name in ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
})  # fmt: skip


@pytest.fixture(scope="module")
def fine() -> tuple[Any, Any]:
    return fine_pair(TRUTH, 3)


def noisy(light: Any, seed: int) -> Any:
    """Linear light, 0 to 255, with a sensor's noise."""
    return np.clip(light + np.random.default_rng(seed).normal(0.0, 2.0, light.shape), 0.0, 255.0)


def asked(*jobs: dict[str, Any] | str) -> list[dict[str, Any]]:
    said = io.StringIO()
    serve(io.StringIO("".join((job if isinstance(job, str) else json.dumps(job)) + "\n" for job in jobs)), said)
    return [json.loads(line) for line in said.getvalue().splitlines()]


def job_of(folder: Path, calibration: CameraCalibration, left: Any, right: Any, **more: Any) -> dict[str, Any]:
    paths = {}
    for side, picture in (("left", left), ("right", right)):
        cv2.imwrite(str(folder / f"{side}.png"), picture)
        paths[side] = [str(folder / f"{side}.png")]
    return {**paths, "calibration": calibration.model_dump(mode="json"), "cell": CELL, **more}


def require_found(answer: dict[str, Any], lateral_m: float = 0.15e-3) -> None:
    assert answer["located"], answer["refusal"]
    delta = Pose.from_matrix(answer["pose_base_hole"]).inverse() @ TRUTH
    off = np.concatenate([delta.translation_m, delta.rotvec_rad()])
    assert np.hypot(off[0], off[1]) < lateral_m and abs(off[2]) < 1e-3
    assert np.linalg.norm(off[3:5]) < np.deg2rad(1.5) and abs(off[5]) < np.deg2rad(0.3)
    covariance = np.array(answer["covariance"])
    assert covariance.shape == (6, 6) and off @ np.linalg.solve(covariance, off) < 27.86


def test_cameras_neither_equal_nor_parallel_with_bent_lenses_find_the_hole(
    fine: tuple[Any, Any], tmp_path: Path
) -> None:
    barrel = PINHOLE.model_copy(
        update={"distortion_model": DistortionModel.PLUMB_BOB, "distortion": (-0.3, 0.08, 1e-3, -5e-4)}
    )
    fisheye = CameraModel(
        width_px=800, height_px=600, fx_px=480.0, fy_px=478.0, cx_px=404.0, cy_px=297.0,
        distortion_model=DistortionModel.FISHEYE, distortion=(0.05, -0.02, 0.004, -0.001),
    )  # fmt: skip
    turns = Pose.from_rotvec([0.01, 0.02, -0.03], [0.0] * 3), Pose.from_rotvec([-0.02, -0.08, 0.05], [0.0] * 3)
    calibration = calibration_of(barrel, fisheye, *turns)
    pictures = [
        np.rint(noisy(seen_by(fine[side], told, turns[side]), side)).astype(np.uint8)
        for side, told in enumerate((barrel, fisheye))
    ]
    (answer,) = asked(job_of(tmp_path, calibration, *pictures))
    require_found(answer)
    assert set(answer) == {"located", "pose_base_hole", "covariance", "refusal", "time_s", "quality", "warnings"}


def test_a_colour_photo_of_16_bits_with_a_gamma_and_a_grey_one_of_8_are_one_light(
    fine: tuple[Any, Any], tmp_path: Path
) -> None:
    left = noisy(seen_by(fine[0], PINHOLE, STILL), 0) / 255.0
    bent = np.where(left <= 0.0031308, 12.92 * left, 1.055 * left ** (1 / 2.4) - 0.055)
    srgb = PINHOLE.model_copy(update={"gamma": Gamma.SRGB})
    colour = np.repeat(np.rint(bent * 65535.0).astype(np.uint16)[..., None], 3, axis=2)
    right = np.rint(noisy(seen_by(fine[1], PINHOLE, STILL), 1)).astype(np.uint8)
    (answer,) = asked(job_of(tmp_path, calibration_of(srgb, PINHOLE, STILL, STILL), colour, right))
    require_found(answer)


def test_of_several_lights_the_one_that_shows_the_hole_is_taken_and_the_pictures_say_what_was_seen(
    fine: tuple[Any, Any], tmp_path: Path
) -> None:
    calibration = calibration_of(PINHOLE, PINHOLE, STILL, STILL)
    pictures = [np.rint(noisy(seen_by(fine[side], PINHOLE, STILL), side)).astype(np.uint8) for side in range(2)]
    job = job_of(tmp_path, calibration, *pictures, annotated=str(tmp_path / "seen" / "here"))
    dark = tmp_path / "dark.png"
    cv2.imwrite(str(dark), pictures[0] // 20)
    both, none = asked(
        {**job, "left": [str(dark), *job["left"]], "right": [str(dark), *job["right"]]},
        {**job, "left": [str(dark)], "right": [str(dark)], "annotated": str(tmp_path / "refused")},
    )
    require_found(both)
    assert (both["quality"]["lights"], both["quality"]["lights_refused"]) == (2.0, 1.0)
    assert not none["located"] and none["pose_base_hole"] is None and none["covariance"] is None
    assert none["refusal"]["code"] and none["refusal"]["text"]
    for folder in ("seen/here", "refused"):
        for side in ("left", "right"):
            drawn = cv2.imread(str(tmp_path / folder / f"{side}.png"))
            assert drawn is not None and drawn.shape == (480, 640, 3)
            assert np.any(drawn[..., 0] != drawn[..., 2])  # something is drawn in colour


def test_a_lens_that_is_not_as_calibrated_is_told_by_straight_edges(fine: tuple[Any, Any], tmp_path: Path) -> None:
    barrel = PINHOLE.model_copy(update={"distortion_model": DistortionModel.PLUMB_BOB, "distortion": (-0.15,)})
    pictures = [np.rint(noisy(seen_by(fine[side], barrel, STILL), side)).astype(np.uint8) for side in range(2)]
    wrong, right = asked(
        job_of(tmp_path, calibration_of(PINHOLE, PINHOLE, STILL, STILL), *pictures),
        job_of(tmp_path, calibration_of(barrel, barrel, STILL, STILL), *pictures),
    )
    for side in ("left", "right"):
        assert wrong["quality"][f"bow_sure_{side}"] == 1.0
        assert wrong["quality"][f"bow_k1_{side}"] == pytest.approx(-0.15, abs=0.06)
        assert right["quality"][f"bow_sure_{side}"] == 0.0
        assert abs(right["quality"][f"bow_k1_{side}"]) < 3.0 * right["quality"][f"bow_k1_sd_{side}"]
    require_found(right)


def test_a_hole_that_was_moved_between_two_lights_is_doubted(fine: tuple[Any, Any], tmp_path: Path) -> None:
    calibration = calibration_of(PINHOLE, PINHOLE, STILL, STILL)
    pictures = [np.rint(noisy(seen_by(fine[side], PINHOLE, STILL), side)).astype(np.uint8) for side in range(2)]
    job = job_of(tmp_path, calibration, *pictures)
    for side, picture in zip(("left", "right"), pictures, strict=True):
        moved = np.vstack([picture[3:], picture[-3:]])
        cv2.imwrite(str(tmp_path / f"moved_{side}.png"), moved)
        job[side].append(str(tmp_path / f"moved_{side}.png"))
    (answer,) = asked(job)
    assert answer["refusal"]["code"] == "doubtful" and "moved between" in answer["refusal"]["text"]


def test_a_job_that_cannot_be_done_is_told_its_field_and_the_next_one_is_done(
    fine: tuple[Any, Any], tmp_path: Path
) -> None:
    calibration = calibration_of(PINHOLE, PINHOLE, STILL, STILL)
    pictures = [np.rint(noisy(seen_by(fine[side], PINHOLE, STILL), side)).astype(np.uint8) for side in range(2)]
    good = job_of(tmp_path, calibration, *pictures, method="paper")
    text, small, real = tmp_path / "text.png", tmp_path / "small.png", tmp_path / "real.tiff"
    text.write_text("no picture", encoding="utf-8")
    cv2.imwrite(str(small), pictures[0][:, :600])
    cv2.imwrite(str(real), pictures[0].astype(np.float32))
    wrong: list[tuple[dict[str, Any] | str, str, str]] = [
        ("{", "job", "JSON"),
        ("[]", "job", "object"),
        ({**good, "left": [str(tmp_path / "none.png")]}, "left", "cannot be read"),
        ({**good, "right": [str(text)]}, "right", "not a picture"),
        ({**good, "right": [str(small)]}, "right", "is 600 x 480, calibration.right says 640 x 480"),
        ({**good, "left": [str(real)]}, "left", "8 or 16 bits"),
        ({**good, "left": [*good["left"], *good["left"]]}, "right", "2 pictures left and 1 right"),
        ({**good, "left": []}, "left", "at least 1"),
        ({**good, "hurry": True}, "hurry", "not permitted"),
        ({**good, "cell": str(tmp_path / "no.yaml")}, "cell", "no.yaml"),
        ({**good, "method": "guess"}, "method", "'rim'"),
        ({**good, "calibration": {**good["calibration"], "left": {}}}, "calibration.left.width_px", "required"),
    ]
    answers = asked(*(job for job, _, _ in wrong), good)
    for (_, field, said), answer in zip(wrong, answers, strict=False):
        assert answer.keys() == {"error"}
        assert answer["error"]["field"] == field and said in answer["error"]["text"], answer
    assert answers[-1]["located"] and OWN.width_px == 640


def test_one_light_that_shows_a_print_for_certain_outweighs_another_that_gives_a_pose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Print(VisionRefusal):
        code = "flat_print"

    pose = Located(NOMINAL, np.eye(6), {}, np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1, 3), np.uint8))

    def lights(*told: Any) -> tuple[Located | None, list[VisionRefusal]]:
        answers = iter(told)

        def located(*_: Any) -> Located:
            answer = next(answers)
            if isinstance(answer, VisionRefusal):
                raise answer
            return pose

        monkeypatch.setitem(offline.METHODS, LocateMethod.RIM, located)
        calibration = calibration_of(PINHOLE, PINHOLE, STILL, STILL)
        job = offline.Job(left=("l",), right=("r",), calibration=calibration)
        nothing = np.zeros((1, 1), np.float32)
        return offline.locate(job, offline.Scene.of(calibration, load_cell(CELL)), [(nothing, nothing)] * len(told))

    assert lights(pose, NoCross("dark"))[0] is pose
    found, refusals = lights(NoCross("dark"), pose, Print("seen"))
    assert found is None and [refusal.code for refusal in refusals] == ["flat_print", "no_cross"]
