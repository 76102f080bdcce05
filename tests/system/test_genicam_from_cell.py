"""What one cell renders another sees through GigE Vision: simulated cell, rendered cameras, driver, all processes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import NoService
from crosspih_common.keys import CAPTURE, IMAGE_LEFT, IMAGE_RIGHT
from crosspih_common.messages import CaptureStereo, StereoPair
from services.operator.bench.pictures.camera.cameras import cell_pair
from tests.conftest import ServiceProcess
from tests.hardware.drivers.genicam.private_network import LEFT, RIGHT, camera_network

DEADLINE_S = 120.0


@pytest.fixture(autouse=True)
def network() -> Iterator[None]:
    with camera_network():
        yield


def captured(bus: Bus, command: CaptureStereo) -> StereoPair:
    """A capture, asked for until the camera's service is there."""
    until_s = time.monotonic() + DEADLINE_S
    while True:
        try:
            return bus.call(CAPTURE, command, DEADLINE_S)
        except NoService:
            if time.monotonic() > until_s:
                raise


def test_a_cell_sees_through_gige_vision_what_another_renders(
    network: None,
    endpoint: str,
    spawn: Callable[..., ServiceProcess],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CROSSPIH_SPEED", "max")
    rendering, seeing = tmp_path / "rendering.yaml", tmp_path / "seeing.yaml"
    rendering.write_text("cell: {name: rendering}\n")
    calibration = tmp_path / "cameras.json"
    calibration.write_text(json.dumps(cell_pair().said()))
    seeing.write_text(
        f"""
cell: {{name: seeing}}
hardware:
  drivers: {{camera: genicam}}
  genicam: {{left: {LEFT}, right: {RIGHT}, calibration: {calibration}, exposure_s: 0.02, gain: 0, skew_most_s: 0.2,
            frame_wait_s: 30, lamps: [{{line: Line2, output: UserOutput0}}, {{line: Line3, output: UserOutput1}}]}}
"""
    )
    spawn("hardware", "--cell", str(rendering), "--endpoint", endpoint).wait_for_line("physics by", DEADLINE_S)
    with (
        Bus(open_zenoh(endpoint), "rendering", "operator") as one,
        Bus(open_zenoh(endpoint), "seeing", "operator") as two,
    ):
        captured(one, CaptureStereo())  # it is there, and its scene is made
        rendered = spawn("operator.bench.protocols.genicam", "--from-cell", "rendering", "--endpoint", endpoint)
        assert rendered.wait_for_line("cameras: left at", DEADLINE_S)
        camera = spawn("hardware", "--devices", "camera", "--cell", str(seeing), "--endpoint", endpoint)
        assert camera.wait_for_line("RENDERED-R", DEADLINE_S), camera.output
        for command in (CaptureStereo(), CaptureStereo(exposure_scale=0.5, lamp=1)):
            drawn = [one.latest(topic, 8) for topic in (IMAGE_LEFT, IMAGE_RIGHT)]
            seen = [two.latest(topic, 8) for topic in (IMAGE_LEFT, IMAGE_RIGHT)]
            pair = captured(two, command)
            assert pair.exposure_s == pytest.approx(0.02 * command.exposure_scale)
            for original, arrived in zip(drawn, seen, strict=True):
                image = arrived.wait_for(lambda sample: bool(sample.stamp_ns == pair.stamp_ns), 10.0)  # noqa: B023
                assert image is not None
                assert any(np.array_equal(image.pixels, each.pixels) for each in original.values())
        assert rendered.terminate() == 0
