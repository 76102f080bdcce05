"""Video sources: files, sequences, both sides in one picture, a live stream that goes away, and what devices make of
settings."""

from __future__ import annotations

import http.server
import json
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.messages import CaptureStereo
from services.hardware.config import HardwareConfig
from services.hardware.drivers.video.source import SourceKind, WantedFormat, kernel_stamp_ns, set_exposure, set_up
from services.hardware.hosting import HostedCell, open_cell
from services.operator.bench.pictures.camera.cameras import cell_pair

WIDTH, HEIGHT, BITS = 640, 480, 24
BEGAN_S = time.monotonic()
SLOWEST_S = 0.5  # from drawing a picture until it is decoded here, on a busy machine


def opened(folder: Path, **video: Any) -> HostedCell:
    calibration = folder / "cameras.json"
    calibration.write_text(json.dumps(cell_pair().said()), encoding="utf-8")
    section = {"calibration": calibration, **video}
    config = HardwareConfig.model_validate({"drivers": {"camera": "video"}, "video": section})
    return open_cell(Workcell(), config, True, frozenset({"camera"}))


def numbered(number: int, width: int = WIDTH) -> NDArray[np.uint8]:
    """A picture that shows a number in bars, which a JPEG does not hurt."""
    picture = np.full((HEIGHT, width), 30, np.uint8)
    for bit in range(BITS):
        if number >> bit & 1:
            picture[:, bit * width // BITS : (bit + 1) * width // BITS] = 220
    return picture


def number_of(picture: NDArray[Any]) -> int:
    width = picture.shape[1]
    return sum(1 << bit for bit in range(BITS) if picture[HEIGHT // 2, (2 * bit + 1) * width // (2 * BITS)] > 125)


def film(path: Path, numbers: range, width: int = WIDTH) -> str:
    # FFV1 loses nothing
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30.0, (width, HEIGHT), False)
    for number in numbers:
        writer.write(numbered(number) if width == WIDTH else np.hstack([numbered(number), numbered(number + 1000)]))
    writer.release()
    return str(path)


def numbers_taken(cell: HostedCell, count: int) -> list[tuple[int, int]]:
    pairs = [cell.camera.capture(CaptureStereo()) for _ in range(count)]
    return [(number_of(pair.left), number_of(pair.right)) for pair in pairs]


def test_each_capture_is_the_next_picture_of_two_video_files(tmp_path: Path) -> None:
    left, right = film(tmp_path / "l.avi", range(3)), film(tmp_path / "r.avi", range(500, 503))
    cell = opened(tmp_path, left=left, right=right)
    try:
        assert numbers_taken(cell, 4) == [(0, 500), (1, 501), (2, 502), (2, 502)]  # the last one over again
        taken = cell.camera.capture(CaptureStereo())
        assert taken.left.shape == (HEIGHT, WIDTH) and np.array_equal(taken.left, numbered(2))
    finally:
        cell.close()


def test_an_image_sequence_in_colour(tmp_path: Path) -> None:
    for number in range(2):
        for side in ("left", "right"):
            colour = np.dstack([numbered(number), np.zeros((HEIGHT, WIDTH), np.uint8), numbered(7)])
            assert cv2.imwrite(str(tmp_path / f"{side}{number:03d}.png"), colour)
    cell = opened(tmp_path, left=str(tmp_path / "left%03d.png"), right=str(tmp_path / "right%03d.png"), colour=True)
    try:
        cell.camera.capture(CaptureStereo())
        taken = cell.camera.capture(CaptureStereo())
        assert taken.left.shape == (HEIGHT, WIDTH, 3)
        # OpenCV writes blue first, the bus has red first
        assert number_of(taken.left[..., 2]) == 1 and number_of(taken.left[..., 0]) == 7
    finally:
        cell.close()


def test_one_picture_with_both_sides(tmp_path: Path) -> None:
    cell = opened(tmp_path, left=film(tmp_path / "both.avi", range(2), 2 * WIDTH))
    try:
        assert numbers_taken(cell, 2) == [(0, 1000), (1, 1001)]
    finally:
        cell.close()


@pytest.mark.parametrize(
    ("sources", "words"),
    [
        ({"left": "nowhere.avi", "right": "nowhere.avi"}, r"video\.left: .*nowhere\.avi is not there"),
        ({"left": "none%03d.png", "right": "none%03d.png"}, r"video\.left: no picture is called like .*none%03d\.png"),
        (
            {"left": "both.avi", "right": "both.avi"},
            r"both\.avi gives 1280 x 480, the calibration says 640 x 480",
        ),
        ({"left": "one.avi"}, r"one\.avi gives 640 x 480, .* both sides beside each other, 1280 x 480"),
        ({"left": "one.avi", "right": "http://127.0.0.1:9/"}, r"video\.left, right: one is a file, the other goes on"),
        ({"left": "cameras.json", "right": "cameras.json"}, r"hardware\.video: .*cameras\.json cannot be opened"),
        ({"left": "/dev/video99", "right": "/dev/video98"}, r"/dev/video99 cannot be opened; is it plugged in"),
    ],
)
def test_a_source_that_cannot_be_is_named(tmp_path: Path, sources: dict[str, str], words: str) -> None:
    film(tmp_path / "both.avi", range(1), 2 * WIDTH)
    film(tmp_path / "one.avi", range(1))
    here = {side: name if name.startswith(("/dev", "http")) else str(tmp_path / name) for side, name in sources.items()}
    with pytest.raises(ConfigError, match=words):
        opened(tmp_path, **here)


# ---------------------------------------------------------------------------------------------------- a live stream


class Server(http.server.ThreadingHTTPServer):
    """Sends pictures as JPEGs that follow each other (multipart/x-mixed-replace), as network cameras do; each shows
    the millisecond in which it was drawn."""

    daemon_threads = True
    gone = False


class Stream(http.server.BaseHTTPRequestHandler):
    server: Server

    def log_message(self, format: str, *arguments: object) -> None:
        pass

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        try:
            while not self.server.gone:
                jpeg = cv2.imencode(".jpg", numbered(now_ms()))[1].tobytes()
                head = b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg)
                self.wfile.write(head + jpeg + b"\r\n")
                time.sleep(1 / 30)  # the camera's rate
        except OSError:
            return


def now_ms() -> int:
    return round((time.monotonic() - BEGAN_S) * 1e3)


class Camera:
    """A stream whose cable can be pulled."""

    def __init__(self) -> None:
        self.port = 0
        self.plug_in()

    def plug_in(self) -> None:
        self._server = Server(("127.0.0.1", self.port), Stream)
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    def pull_out(self) -> None:
        self._server.gone = True
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


@pytest.fixture
def camera() -> Iterator[Camera]:
    started = Camera()
    yield started
    started.pull_out()


def test_a_live_picture_is_one_that_was_exposed_after_it_was_asked_for(tmp_path: Path, camera: Camera) -> None:
    address = f"http://127.0.0.1:{camera.port}"
    cell = opened(
        tmp_path, left=f"{address}/left", right=f"{address}/right", delay_s=SLOWEST_S, exposure_s=0.001, skew_most_s=0.2
    )
    try:
        for idle_s in (0.0, 0.3):
            quiet = threading.Event()
            quiet.wait(idle_s)  # what came meanwhile is old
            asked_ms = now_ms()
            taken = cell.camera.capture(CaptureStereo())
            assert number_of(taken.left) >= asked_ms and number_of(taken.right) >= asked_ms
            assert taken.host_ns is not None
            drawn_ns = round((BEGAN_S + number_of(taken.left) * 1e-3) * 1e9)
            assert taken.host_ns <= drawn_ns + 2_000_000  # told at the latest when it was
    finally:
        cell.close()


def test_a_stream_that_was_away_for_a_while_is_found_again(tmp_path: Path, camera: Camera) -> None:
    address = f"http://127.0.0.1:{camera.port}"
    cell = opened(tmp_path, left=f"{address}/left", right=f"{address}/right", exposure_s=0.001, skew_most_s=0.2)
    try:
        cell.camera.capture(CaptureStereo())
        camera.pull_out()
        asked_ms = now_ms()
        back = threading.Timer(1.5, camera.plug_in)
        back.start()
        taken = cell.camera.capture(CaptureStereo())
        back.join()
        assert number_of(taken.left) >= asked_ms and number_of(taken.right) >= asked_ms
    finally:
        cell.close()


def test_a_stream_that_stays_away_is_named(tmp_path: Path, camera: Camera) -> None:
    address = f"http://127.0.0.1:{camera.port}"
    cell = opened(
        tmp_path, left=f"{address}/left", right=f"{address}/right", exposure_s=0.001, skew_most_s=0.2,
        patience_s=0.5, frame_wait_s=0.5,
    )  # fmt: skip
    try:
        camera.pull_out()
        with pytest.raises(CommandRefused, match=r"camera_away: http://127\.0\.0\.1:\d+/left"):
            while True:  # pictures that were under way still come
                cell.camera.capture(CaptureStereo())
    finally:
        cell.close()
        camera.plug_in()


# ------------------------------------------------------------------------------ what a device makes of its settings


class Device:
    """Heeds settings as uvcvideo does: the nearest that the device has, and "yes" to everything."""

    def __init__(self, formats: dict[str, list[tuple[int, int]]], longest: float = 5000.0, manual: bool = True) -> None:
        self._formats, self._longest, self._manual = formats, longest, manual
        first = next(iter(formats))
        self.held = {
            cv2.CAP_PROP_FOURCC: float(cv2.VideoWriter.fourcc(*first)), cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
            cv2.CAP_PROP_FPS: 30.0, cv2.CAP_PROP_EXPOSURE: 156.0, cv2.CAP_PROP_GAIN: 0.0,
            cv2.CAP_PROP_FRAME_WIDTH: 320.0, cv2.CAP_PROP_FRAME_HEIGHT: 240.0, cv2.CAP_PROP_POS_MSEC: 0.0,
        }  # fmt: skip

    def get(self, prop: int, /) -> float:
        return self.held.get(prop, 0.0)

    def set(self, prop: int, value: float, /) -> bool:
        if prop == cv2.CAP_PROP_FOURCC and not any(cv2.VideoWriter.fourcc(*name) == value for name in self._formats):
            return True
        if prop == cv2.CAP_PROP_AUTO_EXPOSURE and not self._manual:
            return True
        if prop == cv2.CAP_PROP_EXPOSURE:
            value = min(value, self._longest)
        if prop == cv2.CAP_PROP_GAIN:
            value = min(value, 64.0)
        if prop == cv2.CAP_PROP_FPS:
            value = min(value, 30.0)
        self.held[prop] = value
        if prop in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            self._nearest()
        return True

    def _nearest(self) -> None:
        current = self.held[cv2.CAP_PROP_FOURCC]
        sizes = next(sizes for name, sizes in self._formats.items() if cv2.VideoWriter.fourcc(*name) == current)
        if self.held[cv2.CAP_PROP_FRAME_HEIGHT] not in {float(height) for _, height in sizes}:
            width, height = sizes[0]
            self.held[cv2.CAP_PROP_FRAME_WIDTH], self.held[cv2.CAP_PROP_FRAME_HEIGHT] = float(width), float(height)


WANTED = WantedFormat(1280, 720, "MJPG", 30.0, 0.01, 1e-4, 10.0)
FORMATS = {"YUYV": [(640, 480)], "MJPG": [(1280, 720), (640, 480)]}


def test_a_device_that_can_do_what_is_asked_is_set_to_it() -> None:
    device = Device(FORMATS)
    set_up(device, WANTED, "/dev/video0")
    assert device.get(cv2.CAP_PROP_AUTO_EXPOSURE) == 1.0 and device.get(cv2.CAP_PROP_EXPOSURE) == 100.0
    assert device.get(cv2.CAP_PROP_GAIN) == 10.0
    # a factor that it cannot follow is followed as far as it goes, and told
    assert set_exposure(device, 2.0, 1e-4, "/dev/video0", strict=False) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("device", "change", "words"),
    [
        (Device({"YUYV": [(640, 480)]}), {}, r"video\.format: /dev/video0 gives YUYV, asked for MJPG; .*list-formats"),
        (
            Device(FORMATS),
            {"format": "YUYV"},
            r"/dev/video0 gives 640 x 480, the calibration wants 1280 x 720",
        ),
        (Device(FORMATS, longest=50.0), {}, r"exposure_s: /dev/video0 exposes 0\.005 s, asked for 0\.01"),
        (Device(FORMATS, manual=False), {}, r"set_exposure: /dev/video0 keeps its automatic exposure on \(3\)"),
        (Device(FORMATS), {"gain": 100.0}, r"gain: /dev/video0 keeps 64, asked for 100"),
        (Device(FORMATS), {"frame_rate_hz": 60.0}, r"frame_rate_hz: /dev/video0 gives 30, asked for 60"),
    ],
)
def test_a_setting_that_the_device_did_not_take_is_named(device: Device, change: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        set_up(device, replace(WANTED, **change), "/dev/video0")


def test_the_kernels_stamp_counts_where_it_is_one_of_the_monotonic_clock() -> None:
    device = Device(FORMATS)
    device.held[cv2.CAP_PROP_POS_MSEC] = 5000.0
    assert kernel_stamp_ns(device, SourceKind.DEVICE, 5_040_000_000) == 5_000_000_000
    assert kernel_stamp_ns(device, SourceKind.DEVICE, 9_000_000_000) is None  # another clock, or none
    assert kernel_stamp_ns(device, SourceKind.STREAM, 5_040_000_000) is None


def test_it_is_a_driver_for_cameras_alone(tmp_path: Path) -> None:
    config = HardwareConfig.model_validate(
        {"driver": "video", "video": {"left": "a", "right": "b", "calibration": tmp_path / "c"}}
    )
    with pytest.raises(ConfigError, match="video opens cameras alone"):
        open_cell(Workcell(), config, realtime=True)
    with pytest.raises(ConfigError, match=r"hardware\.video: not in the cell's file"):
        open_cell(
            Workcell(), HardwareConfig.model_validate({"drivers": {"camera": "video"}}), True, frozenset({"camera"})
        )
