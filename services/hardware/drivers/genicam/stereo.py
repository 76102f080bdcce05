"""Two GenICam cameras as a stereo pair: exposed together, checked to be so, taken again, found again."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import dataclass

from crosspih_common.aravis import Library
from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.messages import CameraCalibration
from services.hardware.drivers.genicam.camera import CameraAway, GenicamCamera, IncompletePicture, Picture
from services.hardware.drivers.genicam.config import GenicamConfig
from services.hardware.drivers.genicam.features import FIELD
from services.hardware.drivers.genicam.lamps import Lamps
from services.hardware.protocols import StereoCapture

SHARED_UNCERTAIN_NS = 1_000  # PTP, or one clock for both
CLOSE_S = 5.0
LOSS_MEND = (
    f"a larger receive buffer (sysctl net.core.rmem_max), jumbo frames, {FIELD}.packet_size or packet_delay_ns mend it "
    "(docs/hardware/genicam.md)"
)
APART_MEND = f"wire the cameras ({FIELD}.trigger: wire), or raise skew_most_s where nothing moves in the picture"
CLOCK_MEND = f"the two clocks may not be one (then {FIELD}.clock: own), or wire the cameras ({FIELD}.trigger: wire)"
AGAIN_S = 0.2  # between two attempts to find a camera that is away


class ExposedApart(Exception):
    """The two exposures did not begin together."""


@dataclass(frozen=True, slots=True)
class Skew:
    """How much later the right exposure began than the left one, and how exactly that is known, s."""

    skew_s: float
    uncertainty_s: float


class GenicamPair:
    """Implements CameraDevice."""

    def __init__(self, library: Library, config: GenicamConfig, calibration: CameraCalibration) -> None:
        self._config, self._calibration = config, calibration
        self.left = GenicamCamera(library, "left", config, calibration.left)
        self.right = GenicamCamera(library, "right", config, calibration.right)
        self.exposure_s = config.exposure_s
        self.skew: Skew | None = None  # of the last pair
        self.exposed_apart = 0  # pairs that were thrown away for it
        self._lamps = Lamps(config)
        self._exposure_set_s = self._exposure_got_s = 0.0
        self._stop = threading.Event()
        self._lock = threading.Lock()

    def calibration(self) -> CameraCalibration:
        """As the file says it."""
        return self._calibration

    def connect(self) -> None:
        """Open and set what is not open. Raises CameraAway, ConfigError."""
        for camera in (self.left, self.right):
            if not camera.is_open:
                camera.open()
                try:
                    with camera.answering() as features:
                        self._lamps.set_up(camera.side, features)
                        warmth_c = features.temperature_c()
                except ConfigError:
                    camera.close()
                    raise
                self._exposure_set_s = 0.0  # it is to be set anew
                warmth = "" if warmth_c is None else f", {warmth_c:.1f} degrees C"
                print(f"{camera.who}: {camera.description}{warmth}", file=sys.stderr, flush=True)

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """A pair. A camera that is away is waited for, a pair with losses or exposed apart is taken again.

        Raises CommandRefused: camera_away, incomplete_picture, exposed_apart.
        """
        with self._lock:
            until_s = time.monotonic() + self._config.patience_s
            lost = apart = 0
            while True:
                try:
                    self.connect()
                    return self._take(exposure_scale, lamp)
                except CameraAway as away:
                    if time.monotonic() >= until_s or self._stop.wait(AGAIN_S):
                        text = f"{away}; waited {self._config.patience_s:g} s"
                        raise CommandRefused("camera_away", text) from None
                except IncompletePicture as fault:
                    lost += 1
                    if lost > self._config.retries:
                        raise CommandRefused("incomplete_picture", f"{fault}; so {lost} times; {LOSS_MEND}") from None
                except ExposedApart as fault:
                    apart += 1
                    if apart > self._config.retries:
                        mend = APART_MEND if self._config.clock == "own" else CLOCK_MEND
                        raise CommandRefused("exposed_apart", f"{fault}; so {apart} times; {mend}") from None

    def _take(self, exposure_scale: float, lamp: int) -> StereoCapture:
        config, left, right = self._config, self.left, self.right
        exposure_s = self._expose(self.exposure_s * exposure_scale)
        lit = self._lamps.light(lamp, left, right)
        try:
            if lit and config.lamp_settle_s:
                time.sleep(config.lamp_settle_s)
            asked_ns = time.monotonic_ns()
            left.trigger()
            if config.trigger == "software":
                right.trigger()
            wait_s = exposure_s + config.frame_wait_s
            first = self._of_both(wait_s)
        finally:
            if lit and left.is_open and right.is_open:
                self._lamps.dark(left, right)
        for camera, picture in zip((left, right), first, strict=True):
            # it was exposed after it was asked for and before its first packet came
            camera.clock.observe(picture.camera_ns, asked_ns, max(asked_ns, picture.arrived_ns))
            if config.clock == "own":
                camera.latch_clock()
        self._check_together(*first)
        began_ns, _ = left.clock.host_ns(first[0].camera_ns)
        return StereoCapture(
            stamp_ns=-1,
            host_ns=began_ns,
            exposure_s=exposure_s,
            left=first[0].pixels,
            right=first[1].pixels,
            left_encoding=first[0].encoding,
            right_encoding=first[1].encoding,
        )

    def _of_both(self, wait_s: float) -> tuple[Picture, Picture]:
        """Both pictures are fetched even when one is lost, so that none is left over for the next pair."""
        fault: IncompletePicture | None = None
        pictures: list[Picture] = []
        for camera in (self.left, self.right):
            try:
                pictures.append(camera.picture(wait_s))
            except IncompletePicture as incomplete:
                fault = incomplete
        if fault is not None:
            raise fault
        return pictures[0], pictures[1]

    def _expose(self, wanted_s: float) -> float:
        """Set the exposure of both where it is another than before; what they made of it, s.

        A factor that a camera cannot follow is followed as far as it goes: the exposure that is told is the real one.
        """
        if wanted_s != self._exposure_set_s:
            low_s, high_s, got_s = 0.0, float("inf"), 0.0
            for camera in (self.left, self.right):
                with camera.answering() as features:
                    bounds_s = features.exposure_bounds_s()
                low_s, high_s = max(low_s, bounds_s[0]), min(high_s, bounds_s[1])
            for camera in (self.left, self.right):
                with camera.answering() as features:
                    got_s = max(got_s, features.set_exposure_s(min(max(wanted_s, low_s), high_s)))
            self._exposure_got_s, self._exposure_set_s = got_s, wanted_s
        return self._exposure_got_s

    def _check_together(self, left: Picture, right: Picture) -> None:
        if self._config.clock == "own":
            left_ns, left_off = self.left.clock.host_ns(left.camera_ns)
            right_ns, right_off = self.right.clock.host_ns(right.camera_ns)
            apart_ns, uncertain_ns = right_ns - left_ns, left_off + right_off
        else:
            apart_ns, uncertain_ns = right.camera_ns - left.camera_ns, SHARED_UNCERTAIN_NS
        self.skew = Skew(apart_ns * 1e-9, uncertain_ns * 1e-9)
        if abs(apart_ns) - uncertain_ns > self._config.skew_most_s * 1e9:
            self.exposed_apart += 1
            raise ExposedApart(
                f"the right exposure began {apart_ns * 1e-6:+.3f} ms from the left one, "
                f"+-{uncertain_ns * 1e-6:.3f} ms; {FIELD}.skew_most_s allows {self._config.skew_most_s * 1e3:g} ms"
            )

    def close(self) -> None:
        """Let go of both cameras; a capture that waits for one ends."""
        self._stop.set()
        with self._lock:
            closing = [threading.Thread(target=camera.close, daemon=True) for camera in (self.left, self.right)]
            for thread in closing:
                thread.start()
            for thread in closing:  # one that is away takes some seconds
                thread.join(CLOSE_S)
