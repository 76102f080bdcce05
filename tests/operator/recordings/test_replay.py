"""Replay: which answer belongs to which request, and what differs between two answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from crosspih_common.bus.codec import encode, label_of
from crosspih_common.keys import CAPTURE, LOCATE, NEXT_TOUCH, Topic
from crosspih_common.messages import (
    CameraCalibration,
    CameraModel,
    HoleEstimate,
    LocateHole,
    LocateMethod,
    Message,
    PoseData,
    StereoPair,
)
from crosspih_common.recording import Recorded, Recording
from crosspih_common.recording.comparing import differences
from services.operator.cli.commands import app
from services.operator.recordings.replay.answers import stored_cell
from services.operator.recordings.replay.requests import requests_of
from services.recorder.config import RecorderConfig
from services.recorder.file import RecordingFile, create_file
from services.recorder.sample import Sample

POSE = PoseData(position_m=(0.4, -0.3, 0.2), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
ESTIMATE_THEN = HoleEstimate(
    pose_base_hole=POSE, covariance=(1e-6,) * 36, method=LocateMethod.RIM, orientation_measured=True, capture_id=3,
    capture_wall_s=0.1, diagnostics={"cost": 0.5, "looks": 1.0},
)  # fmt: skip
CAMERA = CameraModel(width_px=64, height_px=48, fx_px=40.0, fy_px=40.0, cx_px=32.0, cy_px=24.0)
PAIR = StereoPair(
    capture_id=1, exposure_s=0.02,
    calibration=CameraCalibration(left=CAMERA, right=CAMERA, pose_left_right=POSE, pose_base_camera=POSE),
)  # fmt: skip


def recording_of(*said: tuple[Topic[Any], Message, int]) -> Recording:
    """Messages with the cell's time in ms; each arrives a moment after the one before."""
    recording = Recording.empty("a.mcap")
    for index, (topic, message, stamp_ms) in enumerate(said):
        wall_ns = (index + 1) * 1_000_000_000
        key = topic.key("c")
        stamped = message.model_copy(update={"stamp_ns": stamp_ms * 1_000_000})
        recording.samples.setdefault(key, []).append(
            Recorded(key, f"{label_of(topic.type)} 0", encode(stamped), 0, stamped.stamp_ns, wall_ns)
        )
    return recording


def test_an_answer_belongs_to_the_request_before_it_and_pictures_to_the_request_that_took_them() -> None:
    asked = requests_of(
        recording_of(
            (LOCATE.request_echo, LocateHole(), 100),
            (CAPTURE.reply_echo, PAIR, 110),
            (CAPTURE.reply_echo, PAIR, 140),
            (LOCATE.request_echo, LocateHole(method=LocateMethod.PAPER), 200),  # the one before was refused
            (CAPTURE.reply_echo, PAIR, 210),
            (LOCATE.reply_echo, ESTIMATE_THEN, 230),
            (CAPTURE.reply_echo, PAIR, 260),  # somebody else's
            (LOCATE.request_echo, LocateHole(), 300),
        ),
        "vision",
        0.0,
    )
    assert [(round(one.at_s, 3), one.answer is not None, one.first_pair_s, one.pairs) for one in asked] == [
        (0.0, False, None, 0),
        (0.1, True, pytest.approx(0.11), 1),
        (0.2, False, None, 0),
    ]
    assert asked[1].request.method is LocateMethod.PAPER  # type: ignore[attr-defined]


def test_a_request_that_its_own_answer_overtook_has_it_all_the_same() -> None:
    asked = requests_of(
        recording_of(
            (LOCATE.request_echo, LocateHole(), 100),
            (LOCATE.reply_echo, ESTIMATE_THEN, 130),
            (LOCATE.reply_echo, ESTIMATE_THEN, 230),
            (LOCATE.request_echo, LocateHole(), 200),
        ),
        "vision",
        0.05,
    )
    assert [one.answer is not None for one in asked] == [True]


def test_equal_answers_differ_in_nothing_and_others_by_so_much() -> None:
    later = ESTIMATE_THEN.model_copy(update={"stamp_ns": 7, "seq": 9, "capture_id": 1, "capture_wall_s": 4.0})
    assert differences(ESTIMATE_THEN, later) == []
    moved = PoseData(position_m=(0.4, -0.3, 0.2000000000000001), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    found = differences(
        ESTIMATE_THEN,
        ESTIMATE_THEN.model_copy(
            update={"pose_base_hole": moved, "method": LocateMethod.PAPER, "diagnostics": {"cost": 0.75, "new": 1.0}}
        ),
    )
    assert [(row.field, row.by) for row in found] == [
        ("pose_base_hole.position_m[2]", pytest.approx(1e-16, rel=0.2)),
        ("method", None),
        ("diagnostics.cost", 0.25),
        ("diagnostics.looks", None),
        ("diagnostics.new", None),
    ]


def test_the_files_that_a_stored_cell_names_are_named_in_full() -> None:
    recording = Recording.empty("a.mcap")
    recording.metadata["cell"] = {
        "path": "/there/cell.yaml",
        "yaml": yaml.safe_dump({"cell": {"peg": {"outline": "peg.svg"}, "arm": {"urdf": "arm.urdf"}}}),
    }
    assert stored_cell(recording, None)["cell"] == {
        "peg": {"outline": "/there/peg.svg"},
        "arm": {"urdf": "/there/arm.urdf"},
    }


def said_of(tmp_path: Path, *arguments: str, cell: bool = True) -> str:
    path, stream = create_file(tmp_path, "empty")
    metadata = {"cell": {"name": "c", "path": "cell.yaml", "yaml": "cell: {name: c}"}} if cell else {}
    file = RecordingFile(path, stream, RecorderConfig(), metadata)
    topic = NEXT_TOUCH.reply_echo
    file.write(Sample(topic.key("c"), topic, b"{}", 0, 0, 0))
    file.finish({})
    result = CliRunner().invoke(app, ["replay", str(path), *arguments])
    assert result.exit_code == 1
    return result.output


def test_what_cannot_be_asked_again_is_told(tmp_path: Path) -> None:
    said = said_of(tmp_path, "--service", "hardware")
    assert "--service hardware: want one of vision, inference, force_torque, planning" in said
    assert "does not hold its cell's file; name one with --cell" in said_of(tmp_path, cell=False)
    assert "nothing in it can be asked again" in said_of(tmp_path)
