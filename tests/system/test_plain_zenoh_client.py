"""What docs/wire.md tells of the wire, tried by a process that knows nothing else."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosspih_common.bus.codec import label_of, split_label
from crosspih_common.messages import CameraCalibration, CellClock, Dwell, JointState, MotionOutcome, StereoPair
from crosspih_common.refusals import REFUSALS
from services.hardware.drivers.simulated.config import SimulatedSensorConfig
from tests.conftest import ServiceProcess

CLIENT = Path(__file__).with_name("plain_client.py")


@pytest.fixture
def found(endpoint: str, spawn: Callable[..., ServiceProcess], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the client saw of the simulated hardware."""
    monkeypatch.setenv("CROSSPIH_SPEED", "max")
    spawn("hardware", "--endpoint", endpoint)
    done = subprocess.run(
        [sys.executable, "-I", str(CLIENT), endpoint, "cell1"],
        capture_output=True,
        text=True,
        check=False,
        timeout=90.0,
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def refusal(answer: list[str], code: str, *words: str) -> None:
    """A refusal is an error reply: the code, a newline, a text."""
    kind, payload = answer
    given, newline, text = payload.partition("\n")
    assert (kind, given, newline) == ("error", code, "\n")
    assert code in REFUSALS
    for word in words:
        assert word in text


def test_a_plain_client_can_do_what_the_page_says(found: dict[str, Any]) -> None:
    assert found["ours"] == []
    clock_label, clock = found["clock"]
    assert split_label(clock_label)[0] == label_of(CellClock)
    tick = CellClock.model_validate_json(clock)
    assert tick.stamp_ns >= 0 and tick.boot_id and not tick.realtime

    label, payload = found["calibration"]
    assert split_label(label) == (label_of(CameraCalibration), 0)  # published once, before the client came
    calibration = CameraCalibration.model_validate_json(payload)

    label, payload = found["dwell"]
    assert label == label_of(MotionOutcome)  # a reply's label has no number
    outcome = MotionOutcome.model_validate_json(payload)
    assert outcome.duration_s == pytest.approx(0.1)
    # the load on the peg: weight by where the peg points, about the sensor's origin, and bias
    sensor = SimulatedSensorConfig()
    weight = outcome.pose_base_peg.pose().rotation.T @ np.array([0.0, 0.0, -9.81 * sensor.payload_kg])
    expected = np.concatenate([weight, np.cross(sensor.payload_centroid_m, weight)]) + sensor.bias
    assert np.asarray(outcome.wrench_raw[:3]) == pytest.approx(expected[:3], abs=0.1)
    assert np.asarray(outcome.wrench_raw[3:]) == pytest.approx(expected[3:], abs=0.005)
    (request_label, request), (reply_label, reply) = found["dwell_echoes"]
    assert split_label(request_label) == (label_of(Dwell), 0)
    assert split_label(reply_label) == (label_of(MotionOutcome), 0)
    assert Dwell.model_validate_json(request).duration_s == 0.1
    assert MotionOutcome.model_validate_json(reply) == outcome

    numbers = [split_label(label)[1] for label, _ in found["joint_state"]]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    states = [JointState.model_validate_json(payload) for _, payload in found["joint_state"]]
    assert [state.seq for state in states] == numbers
    batches = [json.loads(payload) for _, payload in found["raw"]]
    for first, second in pairwise(batches):  # the stamp is the first sample's time
        assert second["stamp_ns"] - first["stamp_ns"] == len(first["samples"]) * first["period_ns"]

    refusal(found["no_label"], "contract", "no type name", label_of(Dwell))
    refusal(found["wrong_version"], "contract", "crosspih.Dwell/99")
    refusal(found["unknown_field"], "contract", "hurry")
    refusal(found["out_of_bounds"], "contract", "duration_s")
    refusal(found["refused"], "size", "speed_m_s")
    assert found["unserved"] == ["", ""]  # nobody serves it: no reply at all

    pair = StereoPair.model_validate_json(found["capture"][1])
    image = found["image"]
    assert image["stamp_ns"] == pair.stamp_ns and image["frame_id"] == "camera_left"
    assert (image["width"], image["height"]) == (calibration.left.width_px, calibration.left.height_px)
    channels = {"mono8": 1, "rgb8": 3}[image["encoding"]]
    assert image["step"] == channels * image["width"] and image["bytes"] == image["step"] * image["height"]
    assert 20.0 < image["mean"] < 235.0
    assert {"hardware", "camera"} <= set(found["alive"])
