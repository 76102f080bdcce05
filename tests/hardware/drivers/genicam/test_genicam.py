"""Two GenICam cameras against aravis' fake one: the protocol, settings, losses, and cameras that go and come back."""

from __future__ import annotations

import json
import shutil
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosspih_common.aravis import load
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, ConfigError
from services.hardware.config import HardwareConfig
from services.hardware.drivers.genicam.discovery import discovered
from services.hardware.drivers.genicam.opening import open_pair
from services.hardware.drivers.genicam.stereo import GenicamPair
from services.hardware.drivers.registry import OpenRequest
from services.operator.bench.pictures.camera.cameras import cell_pair
from tests.hardware.drivers.genicam.private_network import (
    FAKE_CAMERA,
    FOURTH,
    LEFT,
    RIGHT,
    THIRD,
    FakeCamera,
    camera_network,
)

APART_S = 0.06  # the fake cameras look for a trigger every 40 ms, and the first time after 100 ms
WIDTH, HEIGHT = 640, 480
OWN = {"left": THIRD, "right": FOURTH}  # of the cameras that a test starts for itself


@pytest.fixture(scope="module", autouse=True)
def network() -> Iterator[None]:
    if shutil.which(FAKE_CAMERA) is None:
        pytest.skip(f"no {FAKE_CAMERA}: apt install aravis-tools")
    with camera_network():
        yield


@pytest.fixture
def cameras() -> Iterator[Callable[..., tuple[FakeCamera, FakeCamera]]]:
    started: list[FakeCamera] = []

    def start(*options: str) -> tuple[FakeCamera, FakeCamera]:
        started.extend((FakeCamera(OWN["left"], "L", *options), FakeCamera(OWN["right"], "R", *options)))
        answering(*OWN.values())
        return started[-2], started[-1]

    yield start
    for camera in started:
        camera.kill()


@pytest.fixture(scope="module")
def both(network: None) -> Iterator[None]:
    """A pair of cameras for the tests that leave them as they are."""
    started = FakeCamera(LEFT, "LEFT"), FakeCamera(RIGHT, "RIGHT")
    answering(LEFT, RIGHT)
    yield
    for camera in started:
        camera.kill()


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Callable[..., GenicamPair]]:
    pairs: list[GenicamPair] = []

    def open_with(**settings: Any) -> GenicamPair:
        pairs.append(open_pair(request(tmp_path, **settings)))
        return pairs[-1]

    yield open_with
    for pair in pairs:
        pair.close()


def answering(*addresses: str) -> None:
    """Wait until the cameras answer a discovery: a GVCP command packet (0x42, flag 1, command 2), acknowledged by 3."""
    for address in addresses:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            asking.settimeout(0.05)
            until_s = time.monotonic() + 20.0
            while time.monotonic() < until_s:
                try:
                    asking.sendto(bytes([0x42, 0x01, 0, 2, 0, 0, 0, 1]), (address, 3956))
                    if asking.recv(1024)[2:4] == bytes([0, 3]):
                        break
                except (TimeoutError, ConnectionRefusedError):
                    continue
            else:
                pytest.fail(f"no camera answers at {address}")


def request(folder: Path, **settings: Any) -> OpenRequest:
    calibration = folder / "cameras.json"
    calibration.write_text(json.dumps(cell_pair().said()), encoding="utf-8")
    section = {
        "left": LEFT, "right": RIGHT, "calibration": calibration, "offset_px": (0, 0), "clock": "shared",
        "skew_most_s": APART_S, "exposure_s": 0.01, "retries": 20, **settings,
    }  # fmt: skip
    config = HardwareConfig.model_validate({"drivers": {"camera": "genicam"}, "genicam": section})
    return OpenRequest(Workcell(), config, frozenset({"camera"}), realtime=True)


def ramp(frame: int, scale: float = 1.0) -> np.ndarray[Any, Any]:
    """What the fake camera draws into a Mono8 picture (aravis, arv_fake_camera_diagonal_ramp)."""
    down, across = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.asarray(np.clip(((across + frame + down) % 255) * scale, 0, 255), dtype=np.uint8)


def test_a_pair_by_address_and_by_serial_number_is_what_the_cameras_drew(
    both: None, opened: Callable[..., GenicamPair]
) -> None:
    assert {camera.serial for camera in discovered(load())} == {"LEFT", "RIGHT"}
    pair = opened(right="RIGHT")
    for _ in range(3):
        taken = pair.capture(1.0, 0)
        assert taken.left_encoding == "mono8" and taken.exposure_s == pytest.approx(0.01)
        for side in (taken.left, taken.right):
            assert np.array_equal(side, ramp(int(side[0, 0])))
        assert pair.skew is not None and abs(pair.skew.skew_s) <= APART_S
    assert pair.left.losses.reconnects == 0
    # ten times the exposure: the fake camera's numbers are scaled by 1 + log10(exposure / 10 ms)
    longer = pair.capture(10.0, 0)
    assert longer.exposure_s == pytest.approx(0.1)
    corner = int(longer.left[0, 0])
    assert any(np.array_equal(longer.left, ramp(frame, 2.0)) for frame in range(255) if min(2 * frame, 255) == corner)


@pytest.mark.parametrize(
    ("name", "encoding", "shape", "dtype"),
    [
        ("Mono16", "mono16", (HEIGHT, WIDTH), np.uint16),
        ("BayerRG8", "bayer_rggb8", (HEIGHT, WIDTH), np.uint8),
        ("BayerGB8", "bayer_gbrg8", (HEIGHT, WIDTH), np.uint8),
        ("RGB8", "rgb8", (HEIGHT, WIDTH, 3), np.uint8),
    ],
)
def test_pixel_formats(
    both: None,
    opened: Callable[..., GenicamPair],
    name: str,
    encoding: str,
    shape: tuple[int, ...],
    dtype: type[np.generic],
) -> None:
    taken = opened(pixel_format=name).capture(1.0, 0)
    assert (taken.left_encoding, taken.left.shape, taken.left.dtype) == (encoding, shape, np.dtype(dtype))
    if name == "Mono16":
        down, across = np.mgrid[0:HEIGHT, 0:WIDTH]
        # the fake camera's first frame has a number above 65400
        drawn = ((256 * (across + frame + down) % 65535).astype(np.uint16) for frame in range(65390, 65460))
        assert any(np.array_equal(taken.left, one) for one in drawn)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            {"exposure_s": 5e-6},
            r"exposure_s: ExposureTime of the left camera .* takes 1e-05 to 10 s, not 5e-06",
        ),
        ({"gain": 99.0}, r"genicam\.gain: Gain of the left camera .* takes 0 to 10, not 99"),
        ({"pixel_format": "Mono12"}, r"pixel_format: 'Mono12' is not in PixelFormat of .*Mono8, RGB8, Mono16"),
        ({"pixel_format": "Mono12Packed"}, r"pixel_format: 'Mono12Packed' has no encoding .* want one of Mono8"),
        ({"offset_px": (4000, 0)}, r"offset_px: OffsetX of the left camera .* takes 0 to \d+, not 4000"),
        ({"left": "NOBODY"}, r"\(NOBODY\) was not found; what answers: Fake, serial LEFT, at 127\.0\.0\.2"),
        ({"left": RIGHT}, r"genicam\.left, right: both are 127\.0\.0\.3"),
        ({"clock": "ptp"}, r"genicam\.clock: the left camera .* has no PtpEnable; use clock: own"),
        ({"lamps": [{"line": "Line2"}]}, r"genicam\.lamps\[0\]\.line: the left camera .* has no LineSelector"),
        ({"trigger": "wire"}, r"genicam\.wire: trigger: wire needs it: left_output and right_input"),
        ({"calibration": "nowhere.yaml"}, r"genicam\.calibration: nowhere\.yaml cannot be read"),
    ],
)
def test_a_setting_that_cannot_be_is_named_with_its_limits(
    both: None, tmp_path: Path, settings: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        open_pair(request(tmp_path, **settings))


def test_a_camera_that_another_program_controls_is_named(
    both: None, opened: Callable[..., GenicamPair], tmp_path: Path
) -> None:
    opened()
    with pytest.raises(ConfigError, match=r"left camera .* is controlled by another program"):
        open_pair(request(tmp_path))


def test_exposures_that_are_apart_are_refused(
    both: None, opened: Callable[..., GenicamPair], monkeypatch: pytest.MonkeyPatch
) -> None:
    pair = opened(skew_most_s=1e-9, retries=3)
    trigger = pair.right.trigger

    def late() -> None:
        """By more than a busy machine leaves unknown of the two cameras' clocks."""
        time.sleep(0.4)
        trigger()

    monkeypatch.setattr(pair.right, "trigger", late)
    with pytest.raises(CommandRefused, match=r"exposed_apart.*skew_most_s allows 1e-06 ms.*wire the cameras"):
        pair.capture(1.0, 0)
    assert pair.exposed_apart == 4


def test_pictures_with_losses_are_taken_again_and_counted(
    cameras: Callable[..., Any], opened: Callable[..., GenicamPair]
) -> None:
    cameras("-r", "2")  # of 1000 packets; a picture has some 220
    pair = opened(**OWN, retries=100)
    for _ in range(8):
        taken = pair.capture(1.0, 0)
        assert np.array_equal(taken.left, ramp(int(taken.left[0, 0])))
    assert pair.left.losses.incomplete + pair.right.losses.incomplete > 0
    assert pair.left.losses.packets_missing + pair.right.losses.packets_missing > 0


def test_a_pair_that_never_comes_whole_is_refused(
    cameras: Callable[..., Any], opened: Callable[..., GenicamPair]
) -> None:
    cameras("-r", "300")
    pair = opened(**OWN, retries=2, frame_wait_s=2.0)
    with pytest.raises(CommandRefused, match=r"incomplete_picture.*(are missing|timed out); so 3 times.*packet_size"):
        pair.capture(1.0, 0)


def test_a_camera_that_lost_power_is_found_again(
    cameras: Callable[..., Any], opened: Callable[..., GenicamPair]
) -> None:
    left, _ = cameras()
    pair = opened(**OWN)
    pair.capture(1.0, 0)
    left.kill()
    coming_back = threading.Timer(1.0, left.start_again)
    coming_back.start()
    taken = pair.capture(1.0, 0)
    coming_back.join()
    assert np.array_equal(taken.left, ramp(int(taken.left[0, 0])))
    assert pair.left.losses.reconnects == 1
    left.kill()  # and once more, with nobody asking meanwhile
    left.start_again()
    answering(OWN["left"])
    pair.capture(1.0, 0)
    assert pair.left.losses.reconnects == 2


def test_a_cable_that_was_out_for_a_while(cameras: Callable[..., Any], opened: Callable[..., GenicamPair]) -> None:
    _, right = cameras()
    pair = opened(**OWN, patience_s=20.0)
    pair.capture(1.0, 0)
    right.process.send_signal(signal.SIGSTOP)
    back = threading.Timer(4.0, lambda: right.process.send_signal(signal.SIGCONT))
    back.start()
    pair.capture(1.0, 0)
    back.join()


def test_a_camera_that_stays_away_is_named(cameras: Callable[..., Any], opened: Callable[..., GenicamPair]) -> None:
    _, right = cameras()
    pair = opened(**OWN, patience_s=0.0)
    right.kill()
    with pytest.raises(CommandRefused, match=r"camera_away: the right camera .* does not answer: .*; waited 0 s"):
        pair.capture(1.0, 0)


def test_a_region_that_is_not_the_calibrations_is_named(cameras: Callable[..., Any], tmp_path: Path) -> None:
    cameras()
    words = r"calibration: left says 640 x 480, .* delivers 512 x 512; .*offset_px: \[x, y\]"
    with pytest.raises(ConfigError, match=words):
        open_pair(request(tmp_path, **OWN, offset_px=None))
