"""Two GigE Vision cameras that show rendered pictures, over the network protocol of real ones.

    python -m services.operator.bench.protocols.genicam --left 127.0.0.2 --right 127.0.0.3 --pictures FOLDER
    python -m services.operator.bench.protocols.genicam --left 127.0.0.2 --right 127.0.0.3 --from-cell NAME

GVCP and GVSP are spoken by libaravis' own camera (ArvGvFakeCamera), which an independent client finds, configures and
triggers; this process fills its pictures and answers for what a camera has beside: lines, lamps, temperature, a clock
of its own. The machine needs both addresses, by `ip addr add 127.0.0.2/8 dev lo` and so on, or in a network namespace.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import signal
import sys
import tempfile
import threading
import time
from ctypes import c_char_p, c_double, c_int, c_size_t, c_uint32, c_uint64
from pathlib import Path
from types import TracebackType

import numpy as np

from crosspih_common.aravis import POINTER, Library, load
from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import ConfigError, CrosspihError
from crosspih_common.messages.images import Pixels
from services.operator.bench.protocols import genicam_features as registers
from services.operator.bench.protocols.genicam_frames import (
    CellFrames,
    FileFrames,
    FrameSource,
    SharedPair,
    as_format,
)

FILL = ctypes.CFUNCTYPE(None, POINTER, POINTER, c_uint32, c_uint32, c_uint32)
TRIGGERS_HZ = 1000.0  # how often to look for a trigger in the library's camera
WATCH_S = 0.002
LAMP_LINES = ("Line2", "Line3", "Line5", "Line6")  # lamp 0, 1, ... of the left camera's outputs
WIRE_FROM, WIRE_TO = "Line1", "Line4"  # the left camera's output, the right one's input
NAME_OF = {code: name for name, code in registers.FORMATS.items()}


class RenderedCamera:
    """One camera on one address. `drift` and `offset_s` describe its clock relative to this machine's monotonic one."""

    def __init__(
        self, library: Library, side: str, address: str, serial: str, size_px: tuple[int, int], shots: SharedPair,
        usual_exposure_s: float, xml: Path, offset_s: float = 0.0, drift: float = 0.0,
    ) -> None:  # fmt: skip
        self._library, self.side, self._shots, self._usual_s = library, side, shots, usual_exposure_s
        self._offset_ns, self._drift, self._began_ns = offset_s * 1e9, drift, time.monotonic_ns()
        self.fills = 0
        self.exposed_ns = 0  # when the last picture was exposed, by this machine's monotonic clock
        self.fault = ""
        self._picture: Pixels | None = None
        self._rendering: threading.Thread | None = None
        self.wired_to: RenderedCamera | None = None
        self.lamps_of: RenderedCamera = self
        self.active_low: frozenset[str] = frozenset()  # lines whose lamp is on while they are low
        make = library.function("arv_gv_fake_camera_new_full", POINTER, c_char_p, c_char_p, c_char_p)
        self._camera: int | None = make(address.encode(), serial.encode(), str(xml).encode())
        if not library.function("arv_gv_fake_camera_is_running", c_int, POINTER)(self._camera):
            raise ConfigError(
                f"--{side}: no interface has the address {address}; ip addr add {address}/8 dev lo (as root, or in a "
                "network namespace of your own: unshare -rn)"
            )
        self._fake = library.function("arv_gv_fake_camera_get_fake_camera", POINTER, POINTER)(self._camera)
        width, height = size_px
        for address_, value in (
            (registers.WIDTH, width), (registers.HEIGHT, height), (registers.SENSOR_WIDTH, width),
            (registers.SENSOR_HEIGHT, height), (registers.TRIGGER_SOURCE, registers.SOFTWARE),
            (registers.MINDED_SOURCE, 1), (registers.PTP_STATUS, registers.PTP_SLAVE), (registers.TEMPERATURE, 412),
        ):  # fmt: skip
            self.write(address_, value)
        library.function("arv_fake_camera_set_trigger_frequency", None, POINTER, c_double)(self._fake, TRIGGERS_HZ)
        self._fill = FILL(self._filled)  # the library keeps its address: it must live as long as the camera
        library.function("arv_fake_camera_set_fill_pattern", None, POINTER, FILL, POINTER, POINTER)(
            self._fake, self._fill, None, None
        )

    def read(self, address: int) -> int:
        """Read a register of 32 bits."""
        value = c_uint32()
        self._library.function("arv_fake_camera_read_register", c_int, POINTER, c_uint32, ctypes.POINTER(c_uint32))(
            self._fake, address, ctypes.byref(value)
        )
        return value.value

    def write(self, address: int, value: int) -> None:
        """Write a register of 32 bits."""
        self._library.function("arv_fake_camera_write_register", c_int, POINTER, c_uint32, c_uint32)(
            self._fake, address, value
        )

    def time_ns(self, host_ns: int) -> int:
        """The camera's own clock at a time of this machine's monotonic one."""
        return round(host_ns + self._offset_ns + self._drift * (host_ns - self._began_ns))

    def answer_latch(self) -> None:
        """TimestampLatch: write the camera's present time into TimestampLatchValue."""
        if self.read(registers.LATCH) == 1:
            self.write(registers.LATCH, 0)
            value = self.time_ns(time.monotonic_ns()).to_bytes(8, "big")
            self._library.function("arv_fake_camera_write_memory", c_int, POINTER, c_uint32, c_uint32, c_char_p)(
                self._fake, registers.LATCHED, 8, value
            )

    def line_is_high(self, line: str) -> bool:
        """An output's level: its source, inverted by LineInverter."""
        index = 4 * registers.LINES.index(line)
        source = registers.SOURCES[min(self.read(registers.LINE_SOURCE + index), len(registers.SOURCES) - 1)]
        level = source in registers.OUTPUTS and bool(
            self.read(registers.OUTPUT_VALUE + 4 * registers.OUTPUTS.index(source))
        )
        return level != bool(self.read(registers.LINE_INVERTER + index))

    def lamp(self) -> int:
        """The lamp that is on, 0 where none is: the room's light."""
        lit = (index for index, line in enumerate(LAMP_LINES) if self.line_is_high(line) != (line in self.active_low))
        return next(lit, 0)

    def look_for_trigger(self) -> None:
        """TriggerSoftware: expose, and trigger the camera that is wired to this one."""
        if self.read(registers.TRIGGERED) == 1:
            self.write(registers.TRIGGERED, 0)
            if self.read(registers.TRIGGER_SOURCE) == registers.SOFTWARE:
                self._expose(time.monotonic_ns())

    def _expose(self, now_ns: int) -> None:
        """Start rendering a picture with the present registers; a trigger during that is ignored."""
        if self._rendering is not None and self._rendering.is_alive():
            return
        scale = self.read(registers.EXPOSURE_US) * 1e-6 / self._usual_s
        scale *= math.pow(10.0, self.read(registers.GAIN) * registers.GAIN_STEP_DB / 20.0)
        lamp, self.exposed_ns = self.lamps_of.lamp(), now_ns
        self._rendering = threading.Thread(target=self._render, args=(scale, lamp, now_ns), daemon=True)
        self._rendering.start()
        if self.wired_to is not None and self._pulls_wire(self.wired_to):
            self.wired_to._expose(now_ns)

    def _pulls_wire(self, other: RenderedCamera) -> bool:
        """Whether this camera's output and the other one's input are set to the wire between them."""
        source = registers.SOURCES[self.read(registers.LINE_SOURCE + 4 * registers.LINES.index(WIRE_FROM))]
        listening = registers.TRIGGER_SOURCES[WIRE_TO]
        return source == "ExposureActive" and other.read(registers.TRIGGER_SOURCE) == listening

    def _render(self, scale: float, lamp: int, triggered_ns: int) -> None:
        """Render outside the library's thread, which keeps answering the control channel; then have the
        picture sent.
        """
        try:
            self._picture = self._shots.half(self.side, scale, lamp, triggered_ns * 1e-9)
        except CrosspihError as error:  # nothing is sent in this case
            self.fault = str(error)
            print(f"{self.side} camera: {error}", file=sys.stderr, flush=True)
        else:
            self.write(registers.SEND, 1)

    def _filled(self, buffer: int, _: int, exposure_us: int, gain: int, pixel_format: int) -> None:
        """Fills the picture that the library sends: called on its thread. Without a trigger, running freely, it is
        black.
        """
        library, picture = self._library, self._picture
        if picture is None:
            return
        library.function("arv_buffer_set_timestamp", None, POINTER, c_uint64)(buffer, self.time_ns(self.exposed_ns))
        data = np.ascontiguousarray(as_format(picture, NAME_OF.get(pixel_format, "Mono8"))).tobytes()
        room = int(library.function("arv_fake_camera_get_payload", c_size_t, POINTER)(self._fake))
        into = library.function("arv_buffer_get_data", POINTER, POINTER, POINTER)(buffer, None)
        ctypes.memmove(into, data, min(room, len(data)))
        self._picture = None
        self.fills += 1

    def close(self) -> None:
        """Leave the network."""
        if self._camera is not None:
            self._library.unref(self._camera)
            self._camera = None


class RenderedPair:
    """Both cameras, and the thread that watches their triggers and latches. Use as a context."""

    def __init__(
        self, source: FrameSource, addresses: tuple[str, str], serials: tuple[str, str] = ("RENDERED-L", "RENDERED-R"),
        size_px: tuple[int, int] = (640, 480), usual_exposure_s: float = 0.02,
        offsets_s: tuple[float, float] = (0.0, 0.0), drifts: tuple[float, float] = (0.0, 0.0), library: str = "",
    ) -> None:  # fmt: skip
        loaded = load(library)
        self.shots = SharedPair(source)
        self._folder = tempfile.TemporaryDirectory()
        xml = Path(self._folder.name) / "rendered.xml"
        xml.write_text(registers.description(), encoding="utf-8")
        self.cameras: list[RenderedCamera] = []
        self._stop = threading.Event()
        try:
            for index, side in enumerate(("left", "right")):
                self.cameras.append(
                    RenderedCamera(
                        loaded, side, addresses[index], serials[index], size_px, self.shots, usual_exposure_s, xml,
                        offsets_s[index], drifts[index],
                    )
                )  # fmt: skip
        except BaseException:
            self.close()
            raise
        left, right = self.cameras
        left.wired_to, right.lamps_of = right, left
        self._watch = threading.Thread(target=self._mind_registers, name="registers", daemon=True)
        self._watch.start()

    def _mind_registers(self) -> None:
        while not self._stop.wait(WATCH_S):
            for camera in self.cameras:
                camera.look_for_trigger()
                camera.answer_latch()

    def close(self) -> None:
        """Remove both from the network."""
        self._stop.set()
        if len(self.cameras) == 2:
            self._watch.join()
        for camera in self.cameras:
            camera.close()
        self._folder.cleanup()

    def __enter__(self) -> RenderedPair:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def main() -> int:
    """Serve until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(prog="genicam", description="Two GigE Vision cameras with rendered pictures.")
    parser.add_argument("--left", default="127.0.0.2", help="address of the left camera")
    parser.add_argument("--right", default="127.0.0.3", help="address of the right camera")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--pictures", type=Path, help="folder with left*.png and right*.png")
    source.add_argument("--from-cell", help="name of the cell whose cameras render, on the same router")
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447", help="of the router of --from-cell")
    parser.add_argument("--size", default="640x480", help="width x height, pixels")
    parser.add_argument("--exposure", type=float, default=0.02, help="exposure of the pictures as they are, s")
    parser.add_argument("--clock-offset", type=float, default=0.0, help="of the right camera's clock, s")
    parser.add_argument("--library", default="", help="path of libaravis-0.8")
    given = parser.parse_args()
    width, _, height = given.size.partition("x")
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: stop.set())
    bus = None if given.from_cell is None else Bus(open_zenoh(given.endpoint), given.from_cell, "operator")
    try:
        frames: FrameSource = FileFrames.of_folder(given.pictures) if bus is None else CellFrames(bus)
        with RenderedPair(
            frames, (given.left, given.right), size_px=(int(width), int(height)), usual_exposure_s=given.exposure,
            offsets_s=(0.0, given.clock_offset), library=given.library,
        ) as pair:  # fmt: skip
            print(f"cameras: left at {given.left}, right at {given.right}, {given.size}", flush=True)
            while not stop.wait(0.5):
                pass
            fills = ", ".join(f"{camera.side} {camera.fills}" for camera in pair.cameras)
            print(f"cameras: {pair.shots.shots} shots, pictures sent: {fills}", flush=True)
    except CrosspihError as error:
        print(f"genicam: {error}", file=sys.stderr)
        return 2
    finally:
        if bus is not None:
            bus.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
