"""The rendered GigE Vision cameras, and features of cameras that aravis' own fake camera does not have."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.keys import CAPTURE, IMAGE_LEFT, IMAGE_RIGHT
from crosspih_common.messages import CaptureStereo, Frame, Image, StereoPair
from crosspih_common.messages.images import Pixels
from services.hardware.config import HardwareConfig
from services.hardware.drivers.genicam.opening import open_pair
from services.hardware.drivers.genicam.stereo import GenicamPair
from services.hardware.drivers.registry import OpenRequest
from services.operator.bench.pictures.camera.cameras import cell_pair
from services.operator.bench.protocols import genicam_features as registers
from services.operator.bench.protocols.genicam import RenderedPair
from services.operator.bench.protocols.genicam_frames import CellFrames, FileFrames
from tests.hardware.drivers.genicam.private_network import LEFT, RIGHT, camera_network

SIZE = (480, 640)
APART_S = 0.05  # on a machine that is busy with other things
LAMPS = [
    {"line": "Line2", "output": "UserOutput0"},
    {"line": "Line3", "output": "UserOutput1", "active_low": True},
    {"line": "Line5"},
]


@pytest.fixture(scope="module", autouse=True)
def network() -> Iterator[None]:
    with camera_network():
        yield


class Drawn:
    """A source that draws noise, and remembers what it was asked for."""

    def __init__(self, shape: tuple[int, ...] = SIZE) -> None:
        rng = np.random.default_rng(3)
        self.left: Pixels = rng.integers(0, 120, shape, dtype=np.uint8)
        self.right: Pixels = rng.integers(0, 120, shape, dtype=np.uint8)
        self.asked: list[tuple[float, int]] = []

    def pair(self, exposure_scale: float, lamp: int) -> tuple[Pixels, Pixels]:
        self.asked.append((round(exposure_scale, 3), lamp))
        brighter = [
            np.clip(one.astype(float) * exposure_scale, 0, 255).astype(np.uint8) for one in (self.left, self.right)
        ]
        return brighter[0], brighter[1]


@contextmanager
def seen(folder: Path, rendered: RenderedPair, **settings: Any) -> Iterator[GenicamPair]:
    calibration = folder / "cameras.json"
    calibration.write_text(json.dumps(cell_pair().said()), encoding="utf-8")
    section = {
        "left": LEFT, "right": RIGHT, "calibration": calibration, "clock": "own", "skew_most_s": APART_S,
        "exposure_s": 0.02, "gain": 0.0, "retries": 50, **settings,
    }  # fmt: skip
    config = HardwareConfig.model_validate({"drivers": {"camera": "genicam"}, "genicam": section})
    pair = open_pair(OpenRequest(Workcell(), config, frozenset({"camera"}), realtime=True))
    try:
        yield pair
    finally:
        pair.close()
        assert not [camera.fault for camera in rendered.cameras if camera.fault]


@pytest.fixture(scope="module")
def source() -> Drawn:
    return Drawn()


@pytest.fixture(scope="module")
def rendered(network: None, source: Drawn) -> Iterator[RenderedPair]:
    with RenderedPair(source, (LEFT, RIGHT), offsets_s=(0.0, 5.0), drifts=(2e-5, -3e-5)) as pair:
        yield pair


@pytest.mark.parametrize(
    ("name", "encoding", "expected"),
    [
        ("Mono8", "mono8", lambda grey: grey),
        ("Mono10", "mono16", lambda grey: np.round(grey * (1023 / 255))),
        ("Mono12", "mono16", lambda grey: np.round(grey * (4095 / 255))),
        ("BayerRG8", "bayer_rggb8", lambda grey: grey),
        ("BayerRG12", "bayer_rggb16", lambda grey: np.round(grey * (4095 / 255))),
        ("RGB8", "rgb8", lambda grey: np.repeat(grey[..., None], 3, axis=2)),
    ],
)
def test_what_is_rendered_arrives_bit_for_bit(
    rendered: RenderedPair, source: Drawn, tmp_path: Path, name: str, encoding: str, expected: Callable[[Any], Any]
) -> None:
    with seen(tmp_path, rendered, pixel_format=name) as pair:
        taken = pair.capture(1.0, 0)
    assert (taken.left_encoding, taken.right_encoding) == (encoding, encoding)
    assert np.array_equal(taken.left, expected(source.left))
    assert np.array_equal(taken.right, expected(source.right))


def test_longer_exposures_are_brighter_and_told(rendered: RenderedPair, source: Drawn, tmp_path: Path) -> None:
    with seen(tmp_path, rendered) as pair:
        taken = pair.capture(1.5, 0)
        assert taken.exposure_s == pytest.approx(0.03)
        assert np.array_equal(taken.left, np.clip(source.left * 1.5, 0, 255).astype(np.uint8))
        # the camera's longest is 8 s: what is told is what was exposed
        assert pair._expose(64.0) == pytest.approx(8.0)


def test_the_lamp_that_is_asked_for_burns_during_the_exposure_alone(
    rendered: RenderedPair, source: Drawn, tmp_path: Path
) -> None:
    left = rendered.cameras[0]
    left.active_low = frozenset({"Line3"})
    with seen(tmp_path, rendered, lamps=LAMPS) as pair:
        for lamp, burns in ((0, 0), (1, 1), (2, 2), (5, 0)):  # there is no lamp 5: the usual one
            pair.capture(1.0, lamp)
            assert source.asked[-1] == (1.0, burns)
            # Line3's lamp burns while its line is low
            assert [left.line_is_high(line) for line in ("Line2", "Line3", "Line5")] == [False, True, False]


def test_a_wire_from_the_left_camera_triggers_the_right_one(
    rendered: RenderedPair, source: Drawn, tmp_path: Path
) -> None:
    wire = {"left_output": "Line1", "right_input": "Line4"}
    with seen(tmp_path, rendered, trigger="wire", wire=wire, clock="own") as pair:
        before = [camera.fills for camera in rendered.cameras]
        taken = pair.capture(1.0, 0)
        assert np.array_equal(taken.right, source.right)
        filled = [camera.fills - was for camera, was in zip(rendered.cameras, before, strict=True)]
        assert filled[0] == filled[1] >= 1
        assert rendered.cameras[1].read(registers.TRIGGER_SOURCE) == registers.TRIGGER_SOURCES["Line4"]
    with pytest.raises(ConfigError, match=r"wire\.right_input: 'Line9' is not in TriggerSource of the right camera"):
        open_pair_with(tmp_path, rendered, trigger="wire", wire={**wire, "right_input": "Line9"})


def open_pair_with(folder: Path, rendered: RenderedPair, **settings: Any) -> None:
    with seen(folder, rendered, **settings):
        pass


def test_clocks_of_their_own_are_mapped_with_an_uncertainty_that_holds(rendered: RenderedPair, tmp_path: Path) -> None:
    left, right = rendered.cameras  # the right one's clock is 5 s ahead, and both run at rates of their own
    with seen(tmp_path, rendered, clock="own") as pair:
        for _ in range(5):
            taken = pair.capture(1.0, 0)
            apart_s = (right.exposed_ns - left.exposed_ns) * 1e-9
            assert pair.skew is not None
            assert abs(pair.skew.skew_s - apart_s) <= pair.skew.uncertainty_s + 1e-4
            assert pair.skew.uncertainty_s < 0.02  # by the latch; by the pictures alone it would be many times that
            _, uncertain_ns = pair.left.clock.host_ns(left.time_ns(left.exposed_ns))
            assert taken.host_ns is not None
            assert abs(taken.host_ns - left.exposed_ns) <= uncertain_ns + 100_000
    with pytest.raises(
        ConfigError, match=r"the left camera .* says PtpStatus Listening after 0 s, want Master or Slave"
    ):
        left.write(registers.PTP_STATUS, 4)
        open_pair_with(tmp_path, rendered, clock="ptp", ptp_wait_s=0.0)
    left.write(registers.PTP_STATUS, registers.PTP_SLAVE)
    open_pair_with(tmp_path, rendered, clock="ptp")
    assert left.read(registers.PTP_ENABLE) == 1


def test_features_are_found_by_their_usual_names(rendered: RenderedPair, tmp_path: Path) -> None:
    with seen(tmp_path, rendered, packet_size=1000) as pair:
        features = pair.left.features
        assert features.temperature_c() == pytest.approx(41.2)
        assert features.exposure_bounds_s() == pytest.approx((2e-5, 8.0))
        pair.capture(1.0, 0)
    for settings, words in (
        ({"gain": 30.0}, r"Gain of the left camera .* takes 0 to 24, not 30"),
        ({"lamps": [{"line": "Line9"}]}, r"lamps\[0\]\.line: 'Line9' is not in LineSelector of .* it has Line1, Line2"),
        ({"lamps": [{"line": "Line2", "output": "UserOutput7"}]}, r"lamps\[0\]\.output: 'UserOutput7' is not in"),
    ):
        with pytest.raises(ConfigError, match=words):
            open_pair_with(tmp_path, rendered, **settings)


def test_pictures_of_another_cell_are_captures_there() -> None:
    hub = MemoryHub()
    other, mine = Bus(hub.transport(), "rendering", "hardware"), Bus(hub.transport(), "rendering", "operator")
    drawn = Drawn((4, 6))
    calibration = cell_pair().said()
    asked: list[CaptureStereo] = []

    def capture(command: CaptureStereo) -> StereoPair:
        asked.append(command)
        for topic, frame, pixels in (
            (IMAGE_LEFT, Frame.CAMERA_LEFT, drawn.left), (IMAGE_RIGHT, Frame.CAMERA_RIGHT, drawn.right),
        ):  # fmt: skip
            other.publisher(topic).publish(Image(frame.value, pixels, 17))
        return StereoPair.model_validate(
            {"stamp_ns": 17, "capture_id": 1, "exposure_s": 0.02, "calibration": calibration}
        )

    with other, mine:
        other.serve(CAPTURE, capture)
        left, right = CellFrames(mine).pair(2.0, 1)
    assert np.array_equal(left, drawn.left) and np.array_equal(right, drawn.right)
    assert (asked[0].exposure_scale, asked[0].lamp) == (2.0, 1)


def test_pictures_of_a_folder_come_in_order_and_the_last_one_over_again(tmp_path: Path) -> None:
    for number in range(2):
        for side, value in (("left", 10), ("right", 90)):
            assert cv2.imwrite(str(tmp_path / f"{side}{number}.png"), np.full((4, 6), value + number, np.uint8))
    frames = FileFrames.of_folder(tmp_path)
    assert [(int(left[0, 0]), int(right[0, 0])) for left, right in (frames.pair(1.0, 0) for _ in range(3))] == [
        (10, 90), (11, 91), (11, 91),
    ]  # fmt: skip
    assert int(frames.pair(4.0, 0)[1][0, 0]) == 255
    (tmp_path / "left0.png").unlink()
    with pytest.raises(ConfigError, match="1 left and 2 right pictures"):
        FileFrames.of_folder(tmp_path)
