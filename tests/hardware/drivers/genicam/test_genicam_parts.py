"""What of the GenICam driver needs no camera: pixel formats, the clock's windows, and the cell's time of a picture."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.aravis import load
from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.errors import ConfigError
from crosspih_common.keys import CAPTURE, IMAGE_LEFT
from crosspih_common.messages import CameraCalibration, CaptureStereo
from services.hardware.drivers.genicam.clock import DRIFT, WindowClock
from services.hardware.drivers.genicam.formats import FORMATS, code_of, pixels_of
from services.hardware.hosting import HostedCamera
from services.hardware.protocols import StereoCapture
from services.hardware.shells.camera import CameraShell
from services.hardware.shells.cell_time import CellTime
from services.operator.bench.pictures.camera.cameras import cell_pair


def test_bytes_become_pixels_and_padding_at_the_ends_of_rows_goes() -> None:
    pixels, encoding = pixels_of(bytes([1, 2, 9, 3, 4]), 0x01080001, 2, 2, row_padding=1)
    assert encoding == "mono8" and pixels.tolist() == [[1, 2], [3, 4]]
    pixels, encoding = pixels_of(bytes([0x34, 0x0F, 0xFF, 0x00]), 0x01100005, 2, 1)
    assert encoding == "mono16" and pixels.tolist() == [[0x0F34, 0x00FF]]
    pixels, encoding = pixels_of(bytes(range(6)), 0x02180014, 2, 1)
    assert encoding == "rgb8" and pixels.tolist() == [[[0, 1, 2], [3, 4, 5]]]


@pytest.mark.parametrize(
    ("code", "name", "encoding"),
    [
        # GenICam Pixel Format Values, EMVA, version 1.1
        (0x01080008, "BayerGR8", "bayer_grbg8"), (0x01080009, "BayerRG8", "bayer_rggb8"),
        (0x0108000A, "BayerGB8", "bayer_gbrg8"), (0x0108000B, "BayerBG8", "bayer_bggr8"),
        (0x0110000D, "BayerRG10", "bayer_rggb16"), (0x01100013, "BayerBG12", "bayer_bggr16"),
        (0x0110002E, "BayerGR16", "bayer_grbg16"), (0x01100007, "Mono16", "mono16"), (0x02180015, "BGR8", "bgr8"),
    ],
)  # fmt: skip
def test_formats_are_known_by_their_published_codes(code: int, name: str, encoding: str) -> None:
    assert (FORMATS[code].name, FORMATS[code].encoding) == (name, encoding)
    assert code_of(name) == code


def test_a_picture_that_is_too_short_or_packed_is_refused() -> None:
    with pytest.raises(ValueError, match="3 bytes are no 2 x 2 of Mono8"):
        pixels_of(bytes(3), 0x01080001, 2, 2)
    with pytest.raises(ValueError, match=r"0x010c0047 has no encoding; set one of Mono8"):
        pixels_of(bytes(3), 0x010C0047, 2, 1)
    assert code_of("Mono12Packed") is None and code_of("RGB8Packed") == 0x02180014


def test_a_library_that_is_not_there_is_named_with_the_mend() -> None:
    with pytest.raises(ConfigError, match=r"genicam\.library: .*nowhere\.so.*apt install libaravis"):
        load("/nowhere.so")


@given(
    offset_s=st.floats(-1e6, 1e6),
    drift=st.floats(-0.4 * DRIFT, 0.4 * DRIFT),
    events=st.lists(
        st.tuples(st.floats(1e-3, 20.0), st.floats(0.0, 0.05), st.floats(0.0, 0.05)), min_size=1, max_size=60
    ),
)
def test_the_truth_lies_within_the_clocks_uncertainty(
    offset_s: float, drift: float, events: list[tuple[float, float, float]]
) -> None:
    clock, host_ns = WindowClock(), 10**12
    for step_s, before_s, after_s in events:
        host_ns += round(step_s * 1e9)
        camera_ns = round(host_ns * (1.0 + drift) + offset_s * 1e9)
        clock.observe(camera_ns, host_ns - round(before_s * 1e9), host_ns + round(after_s * 1e9))
        told_ns, uncertain_ns = clock.host_ns(camera_ns)
        assert abs(told_ns - host_ns) <= uncertain_ns + 2_000
        assert uncertain_ns <= round((before_s + after_s) * 0.5e9) + 2_000
    assert clock.restarts == 0


def test_a_camera_that_was_restarted_begins_a_new_clock() -> None:
    clock = WindowClock()
    with pytest.raises(ValueError, match="nothing was observed"):
        clock.host_ns(0)
    clock.observe(50_000_000_000, 1_000_000, 2_000_000)
    clock.observe(100, 2_001_000_000, 2_002_000_000)
    assert clock.restarts == 1
    assert clock.host_ns(100) == (2_001_500_000, 500_000)
    with pytest.raises(ValueError, match="latest time is before"):
        clock.observe(0, 1, 0)


def test_an_instant_of_the_host_is_told_in_the_cells_time() -> None:
    cell_time = CellTime()
    assert [cell_time.stamp_ns(5), cell_time.stamp_ns(5)] == [0, 1]  # no clock: stamps only go onward
    before_ns = time.monotonic_ns()
    cell_time.tick(7_000_000_000, "a", True)
    after_ns = time.monotonic_ns()
    asked_ns = after_ns + 3_000_000
    stamp_ns = cell_time.stamp_ns(asked_ns)
    assert 7_003_000_000 <= stamp_ns <= 7_003_000_000 + after_ns - before_ns
    cell_time.tick(7_000_000_000, "a", True)  # a tick that was heard late changes nothing
    assert cell_time.stamp_ns(asked_ns) == stamp_ns + 1
    cell_time.tick(9_000_000_000, "a", False)  # time that stands between commands is the newest tick's
    assert cell_time.stamp_ns(0) == 9_000_000_000


class OfTheHost:
    """A camera that knows the host's clock alone."""

    exposure_s = 0.01

    def calibration(self) -> CameraCalibration:
        return CameraCalibration.model_validate(cell_pair().said())

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        grey = np.zeros((480, 640), np.uint8)
        return StereoCapture(-1, self.exposure_s, grey, grey, host_ns=time.monotonic_ns())


def test_pictures_on_the_bus_carry_the_cells_time() -> None:
    hub, cell_time = MemoryHub(), CellTime()
    with Bus(hub.transport(), "cell1", "camera") as camera, Bus(hub.transport(), "cell1", "operator") as mine:
        CameraShell(HostedCamera(OfTheHost(), None, False), camera, "camera", cell_time)
        images = mine.latest(IMAGE_LEFT, 4)
        first = mine.call(CAPTURE, CaptureStereo(), 5.0)
        cell_time.tick(40_000_000_000, "a", True)
        second = mine.call(CAPTURE, CaptureStereo(), 5.0)
        assert first.stamp_ns == 0 and 40_000_000_000 <= second.stamp_ns < 45_000_000_000
        for pair in (first, second):
            assert images.wait_for(is_of(pair.stamp_ns), 5.0) is not None


def is_of(stamp_ns: int) -> Callable[[Any], bool]:
    return lambda image: bool(image.stamp_ns == stamp_ns)
