"""Binds the stereo camera to its keys."""

from __future__ import annotations

from crosspih_common.bus import Bus
from crosspih_common.keys import CAMERA_ALIVE, CAMERA_CALIBRATION, CAPTURE, IMAGE_LEFT, IMAGE_RIGHT
from crosspih_common.messages import CaptureStereo, Frame, Image, StereoPair
from services.hardware.hosting import HostedCamera
from services.hardware.shells.cell_time import CellTime


class CameraShell:
    """Serves captures; the pictures go out before the reply that names them."""

    def __init__(self, camera: HostedCamera, bus: Bus, lane: str, cell_time: CellTime) -> None:
        self._camera, self._bus, self._time = camera, bus, cell_time
        self._captures = 0
        self._images = bus.publisher(IMAGE_LEFT), bus.publisher(IMAGE_RIGHT)
        bus.publisher(CAMERA_CALIBRATION).publish(camera.calibration())
        bus.serve(CAPTURE, self._capture, lane=lane)
        if bus.service != CAMERA_ALIVE:  # a process that has only the camera is called so itself
            bus.also_close(bus.authors.claim(CAMERA_ALIVE))
            bus.declare_alive(CAMERA_ALIVE)

    def _capture(self, command: CaptureStereo) -> StereoPair:
        taken = self._camera.capture(command)
        self._captures += 1
        stamp_ns = taken.stamp_ns if taken.host_ns is None else self._time.stamp_ns(taken.host_ns)
        for publisher, frame, pixels, encoding in zip(
            self._images,
            (Frame.CAMERA_LEFT, Frame.CAMERA_RIGHT),
            (taken.left, taken.right),
            (taken.left_encoding, taken.right_encoding),
            strict=True,
        ):
            publisher.publish(Image(frame.value, pixels, stamp_ns, encoding=encoding))
        return StereoPair(
            stamp_ns=stamp_ns,
            capture_id=self._captures,
            calibration=self._camera.calibration(),
            exposure_s=taken.exposure_s,
        )
