"""What people see while a calibration goes on: pictures that are drawn on, the page, and the numbers so far."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rich.console import Console

from crosspih_common.calibration.tcp import fit_tip
from crosspih_common.geometry import Pose
from services.operator.calibrate.page import DRAWN, LivePage
from services.operator.calibrate.so_far import SoFar
from services.vision.calibration.__main__ import CalibrationJob, Calibrator
from services.vision.calibration.boards import Board
from services.vision.calibration.drawing import FOUND, NEXT
from tests.calibration.drawn_boards import PATTERN, SIZE, board_poses, draw, scene
from tests.calibration.synthetic_presses import WORKCELL, Machine, Rig


def _near(picture: np.ndarray, at: np.ndarray, colour: tuple[int, int, int], around: int = 6) -> bool:
    u, v = np.rint(at).astype(int)
    part = picture[max(v - around, 0) : v + around, max(u - around, 0) : u + around].reshape(-1, 3).astype(int)
    return bool(np.abs(part - np.array(colour)).max(axis=1).min() < 70)


def test_a_pair_is_drawn_with_its_corners_the_parts_that_are_open_and_the_next_outline(tmp_path: Path) -> None:
    rng, of, board = np.random.default_rng(1), scene(), Board(PATTERN)
    # before the left camera's upper left
    pose = Pose.from_translation([-0.17, -0.12, 0.3])
    files = {}
    for side, name in enumerate(("left", "right")):
        files[name] = str(tmp_path / f"{name}.png")
        cv2.imwrite(files[name], draw(rng, pose, of, side, board))
    wanted = [[[400.0, 300.0], [600.0, 300.0], [600.0, 450.0], [400.0, 450.0]]] * 2
    out = {name: str(tmp_path / file) for name, file in DRAWN.items()}
    job: dict[str, Any] = {"do": "see", "board": str(PATTERN), "pair": files, "draw": {**out, "wanted": wanted}}
    calibrator = Calibrator()
    seen = calibrator.answer(CalibrationJob.model_validate(job))
    assert seen["left"] > 12 and any("left camera" in line for line in seen["missing"])
    drawn = cv2.imread(out["left"])
    assert drawn is not None and drawn.shape[:2] == SIZE[::-1]
    corners = of.cameras[0].project(pose.apply(PATTERN.corners_m()))
    assert all(_near(drawn, at, FOUND) for at in corners[:3])
    assert _near(drawn, np.array([500.0, 300.0]), NEXT) and not _near(drawn, np.array([500.0, 380.0]), NEXT)
    blue, _, red = drawn[220:260, 500:560].reshape(-1, 3).mean(axis=0)  # saw nothing: tinted
    grey = drawn[20:40, 20:60].reshape(-1, 3).mean(axis=0)
    assert red - blue > 20.0 and abs(grey[2] - grey[0]) < 10.0
    before = Path(out["left"]).read_bytes()
    job["pairs"] = [files]
    for side, name in enumerate(("left", "right")):
        files[name] = str(tmp_path / f"{name}-2.png")
        cv2.imwrite(files[name], draw(rng, board_poses(rng, 1, of)[0], of, side, board))
    calibrator.answer(CalibrationJob.model_validate({**job, "pair": files}))
    assert Path(out["left"]).read_bytes() != before and not list(tmp_path.glob("*.partial"))


def _got(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=10.0) as answer:
        return bytes(answer.read())


def test_the_page_tells_what_was_seen_and_shows_the_files_that_are_there(tmp_path: Path) -> None:
    with LivePage(tmp_path, "a title") as page:
        assert b"state.json" in _got(page.address)
        page.say("posture 2 of 20")
        page.add({"left": 20, "right": 18, "both": 17, "all": 24, "missing": ["a tilt"], "parts": []})
        told = json.loads(_got(page.address + "state.json"))
        assert told == {
            "title": "a title", "state": "posture 2 of 20", "missing": ["a tilt"],
            "pairs": [{"left": 20, "right": 18, "both": 17, "all": 24}],
        }  # fmt: skip
        for lost in ("left.jpg", "../pyproject.toml", "taken.yaml"):
            with pytest.raises(urllib.error.HTTPError, match="404") as refused:
                _got(page.address + lost)
            refused.value.close()
        (tmp_path / DRAWN["left"]).write_bytes(b"jpeg")
        assert _got(page.address + "left.jpg?1") == b"jpeg"
    with pytest.raises(urllib.error.URLError):
        _got(page.address)


def test_numbers_so_far_say_what_is_missing_and_then_how_sure_they_are() -> None:
    whole = Rig(Machine(), 1).pressed(12)
    console = Console(width=160)

    def reckon(pressed: object) -> dict[str, object]:
        fit = fit_tip(pressed, WORKCELL, 2)  # type: ignore[arg-type]
        values = [{"name": "peg x", "value": float(fit.shift_m[0]), "sd": float(fit.sd_m[0]), "half_95": 1e-6}]
        return {"values": values, "missing": ["more"]}

    shower = SoFar(console, "the peg", reckon)
    for count, said in ((3, "not yet: 3 pushes, want 7"), (12, "the peg, after 12 pushes")):
        with console.capture() as captured:
            console.print(shower.told(whole.model_copy(update={"presses": whole.presses[:count]})))
        assert said in " ".join(captured.get().split())
    assert "missing: more" in captured.get() and "peg x" in captured.get()
