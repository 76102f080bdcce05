"""One GenICam camera: found, opened, set and checked, triggered, its pictures fetched, let go of."""

from __future__ import annotations

import contextlib
import ctypes
import threading
import time
from collections.abc import Callable, Iterator
from ctypes import byref, c_char_p, c_int, c_size_t, c_uint, c_uint64
from dataclasses import dataclass
from typing import Any

from crosspih_common.aravis import POINTER, AravisError, Library
from crosspih_common.errors import ConfigError
from crosspih_common.messages.camera import CameraModel
from crosspih_common.messages.images import Pixels
from services.hardware.drivers.genicam.clock import WindowClock
from services.hardware.drivers.genicam.config import GenicamConfig
from services.hardware.drivers.genicam.discovery import discovered, found_now
from services.hardware.drivers.genicam.features import FIELD, Features
from services.hardware.drivers.genicam.formats import pixels_of
from services.hardware.drivers.genicam.settings import set_up

BUFFERS = 4
SUCCESS = 0
STATUS = {
    1: "cleared", 2: "frame timed out", 3: "packets are missing", 4: "packets out of order", 5: "size does not fit",
    6: "still filling", 7: "aborted", 8: "no image",
}  # fmt: skip
ADDRESS_PARTS = 4
LATCHES = (("TimestampLatch", "TimestampLatchValue"), ("GevTimestampControlLatch", "GevTimestampValue"))
LATCH_WAIT_NS = 20_000_000


class CameraAway(Exception):
    """The camera does not answer, another program controls it, or its pictures do not come."""


class IncompletePicture(Exception):
    """A picture came, but not all of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One picture; the camera's stamp of its exposure, ns, and when its first packet came, host's monotonic ns."""

    pixels: Pixels
    encoding: str
    camera_ns: int
    arrived_ns: int


@dataclass(slots=True)
class Losses:
    """Counted since the process began."""

    pictures: int = 0
    incomplete: int = 0
    packets_missing: int = 0
    packets_resent: int = 0
    reconnects: int = 0


class GenicamCamera:
    """One camera. Not for two threads at once."""

    def __init__(
        self, library: Library, side: str, config: GenicamConfig, lens: CameraModel, name: str | None = None
    ) -> None:
        self._library, self.side, self._config, self._lens = library, side, config, lens
        self._name = name or str(getattr(config, side))
        self.who = f"the {side} camera ({self._name})"
        self.losses = Losses()
        self.clock = WindowClock()
        self.description = ""
        self._camera: int | None = None
        self._stream: int | None = None
        self._features: Features | None = None
        self._opened_before = False
        self._counted = 0, 0  # packets missing and resent of the present stream, as far as they are in `losses`

    # --------------------------------------------------------------------------------------------- found and let go of

    @property
    def is_open(self) -> bool:
        """Whether it was opened and not given up since."""
        return self._camera is not None

    @property
    def features(self) -> Features:
        """Of the open camera. Raises CameraAway when it is not open."""
        if self._features is None:
            raise CameraAway(f"{self.who} is not open")
        return self._features

    @contextlib.contextmanager
    def answering(self) -> Iterator[Features]:
        """The features, for as long as the camera answers. Raises CameraAway, and has given it up, when it does not."""
        try:
            yield self.features
        except AravisError as error:
            self.give_up()
            raise CameraAway(f"{self.who} does not answer: {error.text}") from None

    def open(self) -> None:
        """Find it, take control of it, set it and let it wait for triggers. Raises CameraAway, ConfigError."""
        try:
            camera = self._library.checked("arv_camera_new", POINTER, c_char_p)(self._key().encode())
        except AravisError as error:
            raise CameraAway(f"{self.who} does not answer: {error.text}") from None
        if not camera:
            raise CameraAway(f"{self.who} was not found; {found_now(self._library)}")
        self._camera = camera
        try:
            self._features = Features(self._library, camera, self.who)
            self._take_control()
            self._library.checked("arv_camera_stop_acquisition", None, POINTER)(camera)
            self.description = self._features.description()
            set_up(self._features, self.side, self._config, self._lens)
            self._start()
        except AravisError as error:
            self.give_up()
            raise CameraAway(f"{self.who} does not answer: {error}") from None
        except CameraAway:
            self.give_up()
            raise
        except BaseException:
            self._let_go(beside=False)
            raise
        if self._opened_before:
            self.losses.reconnects += 1
        self._opened_before = True

    def _key(self) -> str:
        """What the library opens it by: an address as it stands, else the id of what bears that name."""
        if self._name.count(".") == ADDRESS_PARTS - 1 and self._name.replace(".", "").isdigit():
            return self._name
        for device in discovered(self._library):
            if self._name in device:
                return device.device_id
        raise CameraAway(f"{self.who} was not found; {found_now(self._library)}")

    def _take_control(self) -> None:
        if not self._library.function("arv_camera_is_gv_device", c_int, POINTER)(self._camera):
            return  # USB3 Vision has one user at a time anyway
        device = self._library.function("arv_camera_get_device", POINTER, POINTER)(self._camera)
        if not self._library.function("arv_gv_device_is_controller", c_int, POINTER)(device):
            raise CameraAway(
                f"{self.who} is controlled by another program: close its viewer or the other service; a program that "
                "was killed loses control after the camera's heartbeat time, mostly 3 s"
            )

    def give_up(self) -> None:
        """Let go of it, however it is."""
        self._let_go(beside=True)

    def _let_go(self, beside: bool) -> None:
        """`beside`: in a thread, for the library waits for an answer that may never come."""
        held = [one for one in (self._stream, self._camera) if one is not None]
        self._camera, self._stream, self._features = None, None, None

        def let_go() -> None:
            for one in held:
                self._library.unref(one)

        if not beside:
            let_go()
        elif held:
            threading.Thread(target=let_go, name=f"lets-go-of-{self.side}", daemon=True).start()

    def close(self) -> None:
        """Stop it and let go of it."""
        if self._camera is not None:
            with contextlib.suppress(AravisError):  # it is away: there is nothing to stop
                self._library.checked("arv_camera_stop_acquisition", None, POINTER)(self._camera)
                self._let_go(beside=False)
        self._let_go(beside=True)

    # ------------------------------------------------------------------------------------- set, triggered, fetched

    def _start(self) -> None:
        config, library = self._config, self._library
        if library.function("arv_camera_is_gv_device", c_int, POINTER)(self._camera):
            if not config.packet_socket:
                library.function("arv_camera_gv_set_stream_options", None, POINTER, c_int)(self._camera, 1)
            if config.packet_delay_ns is not None:
                library.checked("arv_camera_gv_set_packet_delay", None, POINTER, ctypes.c_int64)(
                    self._camera, config.packet_delay_ns
                )
            if config.packet_size is not None:
                # what was asked for is taken; where the driver is to choose, the library tries which size gets through
                library.function("arv_camera_gv_set_packet_size_adjustment", None, POINTER, c_int)(self._camera, 0)
                library.checked("arv_camera_gv_set_packet_size", None, POINTER, c_int)(self._camera, config.packet_size)
                got = library.checked("arv_camera_gv_get_packet_size", c_uint, POINTER)(self._camera)
                if got != config.packet_size:
                    raise ConfigError(
                        f"{FIELD}.packet_size: {self.who} sends {got} bytes, asked for {config.packet_size}; see its "
                        "manual, or leave the setting out"
                    )
        payload = int(library.checked("arv_camera_get_payload", c_uint, POINTER)(self._camera))
        stream = library.checked("arv_camera_create_stream", POINTER, POINTER, POINTER, POINTER)(
            self._camera, None, None
        )
        if not stream:
            raise CameraAway(f"{self.who} opens no stream")
        self._stream, self._counted = stream, (0, 0)
        if library.function("arv_camera_is_gv_device", c_int, POINTER)(self._camera):
            # a busy machine may be late with packets: a picture is given up only when half of its time is over
            library.set_uint(stream, "frame-retention", round(0.5e6 * config.frame_wait_s))
        for _ in range(BUFFERS):
            self._push(library.function("arv_buffer_new_allocate", POINTER, c_size_t)(payload))
        library.checked("arv_camera_start_acquisition", None, POINTER)(self._camera)
        for _ in range(3):
            self.latch_clock()

    def trigger(self) -> None:
        """Expose now. Raises CameraAway."""
        while buffer := self._call("arv_stream_try_pop_buffer", POINTER, POINTER)(self._stream):
            self._push(buffer)  # what came after it had been given up
        with self.answering():
            self._library.checked("arv_camera_software_trigger", None, POINTER)(self._camera)

    def picture(self, wait_s: float) -> Picture:
        """The picture of the last trigger. Raises CameraAway when none comes, IncompletePicture."""
        buffer = self._call("arv_stream_timeout_pop_buffer", POINTER, POINTER, c_uint64)(
            self._stream, max(1, round(wait_s * 1e6))
        )
        self._count()
        if not buffer:
            self.give_up()
            raise CameraAway(f"{self.who} sent no picture within {wait_s:g} s of its trigger")
        try:
            status = int(self._call("arv_buffer_get_status", c_int, POINTER)(buffer))
            if status != SUCCESS:
                self.losses.incomplete += 1
                raise IncompletePicture(f"{self.who}: {STATUS.get(status, f'buffer status {status}')}")
            self.losses.pictures += 1
            return self._read(buffer)
        finally:
            self._push(buffer)

    def _read(self, buffer: int) -> Picture:
        size = c_size_t()
        start = self._call("arv_buffer_get_image_data", POINTER, POINTER, ctypes.POINTER(c_size_t))(buffer, byref(size))
        width, height, code = (
            int(self._call(f"arv_buffer_get_image_{what}", c_int, POINTER)(buffer))
            for what in ("width", "height", "pixel_format")
        )
        across, down = c_int(), c_int()
        self._call("arv_buffer_get_image_padding", None, POINTER, ctypes.POINTER(c_int), ctypes.POINTER(c_int))(
            buffer, byref(across), byref(down)
        )
        try:
            data = ctypes.string_at(start, size.value)
            pixels, encoding = pixels_of(data, code & 0xFFFFFFFF, width, height, across.value)
        except ValueError as error:
            raise CameraAway(f"{self.who}: {error}") from None
        if (width, height) != (self._lens.width_px, self._lens.height_px):
            raise CameraAway(
                f"{self.who} sent {width} x {height}, the calibration says {self._lens.width_px} x "
                f"{self._lens.height_px}"
            )
        stamp_ns = int(self._call("arv_buffer_get_timestamp", c_uint64, POINTER)(buffer))
        came_ns = int(self._call("arv_buffer_get_system_timestamp", c_uint64, POINTER)(buffer))
        # the library stamps the first packet's arrival by the wall's clock
        arrived_ns = time.monotonic_ns() - max(0, time.time_ns() - came_ns)
        return Picture(pixels, encoding, stamp_ns, arrived_ns)

    def latch_clock(self) -> None:
        """Learn the camera's clock by its latch, where it has one: the time between asking and reading bounds it.

        Raises CameraAway.
        """
        with self.answering() as features:
            for command, value in LATCHES:
                if features.has(command):
                    before, asked_ns = features.integer(value), time.monotonic_ns()
                    features.run(command)
                    while time.monotonic_ns() < asked_ns + LATCH_WAIT_NS:
                        stamp = features.integer(value)
                        if stamp != before:  # one that has not changed was latched before
                            self.clock.observe(self._in_ns(command, stamp), asked_ns, time.monotonic_ns())
                            return
                    return

    def _in_ns(self, command: str, ticks: int) -> int:
        if command.startswith("Gev") and self.features.has("GevTimestampTickFrequency"):
            frequency = self.features.integer("GevTimestampTickFrequency")
            return ticks * 1_000_000_000 // frequency if frequency > 0 else ticks
        return ticks

    def _count(self) -> None:
        """The stream's own counters, since it was opened."""
        if not self._library.function("arv_camera_is_gv_device", c_int, POINTER)(self._camera):
            return
        resent, missing = c_uint64(), c_uint64()
        pointer = ctypes.POINTER(c_uint64)
        self._call("arv_gv_stream_get_statistics", None, POINTER, pointer, pointer)(
            self._stream, byref(resent), byref(missing)
        )
        self.losses.packets_missing += missing.value - self._counted[0]
        self.losses.packets_resent += resent.value - self._counted[1]
        self._counted = missing.value, resent.value

    def _push(self, buffer: int) -> None:
        if self._stream is not None:
            self._call("arv_stream_push_buffer", None, POINTER, POINTER)(self._stream, buffer)

    def _call(self, name: str, returns: Any, *takes: Any) -> Callable[..., Any]:
        if self._camera is None:
            raise CameraAway(f"{self.who} is not open")
        return self._library.function(name, returns, *takes)
