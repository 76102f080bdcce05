"""The examples of docs/examples, each as a process of its own that imports nothing of ours, against our typed bus."""

from __future__ import annotations

import ast
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import CommandRefused, NoService
from crosspih_common.keys import (
    CAMERA_ALIVE,
    CAMERA_CALIBRATION,
    CAPTURE,
    CLOCK,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    LOCATE,
    Command,
)
from crosspih_common.messages import CaptureStereo, CellClock, Dwell, LocateHole, StereoPair
from services.vision.refusals import VisionRefusal
from services.vision.stereo import StereoModel
from tests.conftest import ServiceProcess

CAMERA = Path(__file__).resolve().parents[2] / "docs" / "examples" / "plain_camera.py"
CELL = "cell1"
DEADLINE_S = 20.0
SECOND = 1_000_000_000


@pytest.fixture
def camera(endpoint: str) -> Iterator[subprocess.Popen[str]]:
    # -I: neither this folder nor PYTHONPATH is looked in
    arguments = [sys.executable, "-I", str(CAMERA), "--cell", CELL, "--endpoint", endpoint]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process.stdout:
        assert "serves" in process.stdout.readline()
        yield process
        process.kill()
        process.wait(DEADLINE_S)


def ask(bus: Bus, request: CaptureStereo) -> StereoPair:
    """A declaration takes a moment to come through the router."""
    until = time.monotonic() + DEADLINE_S
    while True:
        try:
            return bus.call(CAPTURE, request, DEADLINE_S)
        except NoService:
            assert time.monotonic() < until, "nobody ever served"


def test_the_plain_camera_imports_nothing_of_ours() -> None:
    modules = {
        (node.module or "") if isinstance(node, ast.ImportFrom) else node.names[0].name
        for node in ast.walk(ast.parse(CAMERA.read_text(encoding="utf-8")))
        if isinstance(node, (ast.Import, ast.ImportFrom))
    }
    assert not [name for name in modules if name.split(".")[0] in ("crosspih_common", "services", "deploy")]


def test_our_services_take_the_plain_camera_for_their_own(endpoint: str, camera: subprocess.Popen[str]) -> None:
    gone, here = threading.Event(), threading.Event()
    with Bus(open_zenoh(endpoint), CELL, "hardware") as cell, Bus(open_zenoh(endpoint), CELL, "vision") as vision:
        vision.watch_alive(lambda name, alive: (here if alive else gone).set() if name == CAMERA_ALIVE else None)
        assert here.wait(DEADLINE_S)
        # late: the calibration was published before we came
        calibration = vision.latest(CAMERA_CALIBRATION).wait_for(lambda _: True, DEADLINE_S)
        assert calibration is not None
        images = vision.latest(IMAGE_LEFT, 2), vision.latest(IMAGE_RIGHT, 2)
        requests, replies = vision.latest(CAPTURE.request_echo), vision.latest(CAPTURE.reply_echo, 4)
        cell.publisher(CLOCK).publish(CellClock(stamp_ns=7 * SECOND, boot_id="b", realtime=True))
        pair = ask(vision, CaptureStereo())
        until = time.monotonic() + DEADLINE_S
        while pair.stamp_ns < 7 * SECOND:  # the tick may still be on its way to the camera
            assert time.monotonic() < until
            pair = ask(vision, CaptureStereo(exposure_scale=2.0))
        pictures = [latest.wait_for(lambda sample: sample.stamp_ns == pair.stamp_ns, DEADLINE_S) for latest in images]
        stereo = StereoModel.of(pair.calibration)
        centres = []
        cameras = pair.calibration.left, pair.calibration.right
        for picture, frame, camera_told in zip(pictures, ("camera_left", "camera_right"), cameras, strict=True):
            assert picture is not None and picture.frame == frame and picture.seq >= 0
            assert picture.pixels.shape == (camera_told.height_px, camera_told.width_px)
            dark = 200.0 - picture.pixels.astype(float)
            centres.append(
                np.array([(dark.sum(axis=0) @ np.arange(dark.shape[1])), (dark.sum(axis=1) @ np.arange(dark.shape[0]))])
                / dark.sum()
            )
        # pixel centres, baseline and axes as the contract says: the square hangs 0.4 m before the left camera
        assert stereo.triangulate(*centres) == pytest.approx([0.0, 0.0, 0.4], abs=1e-4)
        again = ask(vision, CaptureStereo())
        assert again.stamp_ns > pair.stamp_ns and again.capture_id == pair.capture_id + 1
        assert requests.wait_for(lambda _: True, DEADLINE_S) is not None
        assert replies.wait_for(lambda reply: reply.capture_id == again.capture_id, DEADLINE_S) is not None
        wrong = Command(CAPTURE.path, Dwell, StereoPair, "hardware", (), "a request of another type")
        with pytest.raises(CommandRefused, match=r"got crosspih\.Dwell/1, want crosspih\.CaptureStereo/1") as refused:
            vision.call(wrong, Dwell(duration_s=1.0), DEADLINE_S)
        assert refused.value.code == "contract"
        assert not vision.traffic.total("rejected")
        camera.send_signal(signal.SIGTERM)
        assert camera.wait(DEADLINE_S) == 0
        assert gone.wait(DEADLINE_S)


def test_vision_looks_through_the_plain_camera_beside_a_simulated_arm(
    endpoint: str, camera: subprocess.Popen[str], spawn: Callable[..., ServiceProcess], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mixture: another's camera, our arm, our vision. It sees that a square is no hole of the drawing."""
    monkeypatch.setenv("CROSSPIH_SPEED", "max")
    spawn("hardware", "--devices", "arm,force_torque", "--endpoint", endpoint)
    spawn("vision", "--endpoint", endpoint)
    wanted = {"hardware", "vision", CAMERA_ALIVE}
    there, alive = threading.Event(), set[str]()

    def seen(name: str, here: bool) -> None:
        (alive.add if here else alive.discard)(name)
        if wanted <= alive:
            there.set()

    with Bus(open_zenoh(endpoint), CELL, "operator") as operator:
        operator.watch_alive(seen)
        assert there.wait(2 * DEADLINE_S), alive
        pairs = operator.latest(CAPTURE.reply_echo, 8)
        with pytest.raises(CommandRefused) as refused:
            operator.call(LOCATE, LocateHole(), 2 * DEADLINE_S)
        assert refused.value.code in {kind.code for kind in VisionRefusal.__subclasses__()}
        last = pairs.wait_for(lambda pair: pair.capture_id >= 1, DEADLINE_S)
        assert last is not None and last.calibration.left.cx_px == 319.5  # the plain camera's, not the simulator's
