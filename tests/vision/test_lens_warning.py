"""A lens that is not as calibrated: vision gives its pose over the bus, less surely, and tells people once."""

from __future__ import annotations

import itertools
import threading

import numpy as np

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import CameraSection, Workcell, load_cell
from crosspih_common.geometry import Pose
from crosspih_common.keys import CAPTURE, EVENTS, IMAGE_LEFT, IMAGE_RIGHT, LOCATE
from crosspih_common.messages import (
    CameraModel,
    CaptureStereo,
    DistortionModel,
    Event,
    Image,
    LocateHole,
    Severity,
    StereoPair,
)
from crosspih_common.service.lifecycle import ServiceContext
from services.vision.config import VisionConfig
from services.vision.shell import VisionShell
from tests.vision.pictures.lenses import calibration_of, fine_pair, seen_by

TRUTH = Workcell().hole_prior.pose_base_hole() @ Pose.from_rotvec([0.05, -0.04, 0.06], [0.004, -0.003, 0.006])
STILL = Pose.identity()
PINHOLE = CameraModel(**{
    name: getattr(CameraSection(), name) for name in ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
})  # fmt: skip


class BentCamera:
    """A camera on the bus, its lens bent by k1 = -.07 and its calibration that of a pinhole."""

    def __init__(self, bus: Bus) -> None:
        barrel = PINHOLE.model_copy(
            update={"distortion_model": DistortionModel.PLUMB_BOB, "distortion": (-0.07, 0.0065)}
        )
        noise = np.random.default_rng(0)
        self._pictures = [
            np.clip(np.rint(seen_by(fine, barrel, STILL) + noise.normal(0.0, 1.5, (480, 640))), 0, 255).astype(np.uint8)
            for fine in fine_pair(TRUTH, 3)
        ]
        self._publishers = bus.publisher(IMAGE_LEFT), bus.publisher(IMAGE_RIGHT)
        self._numbers = itertools.count(1)
        bus.serve(CAPTURE, self._capture)

    def _capture(self, _: CaptureStereo) -> StereoPair:
        number = next(self._numbers)
        for publisher, side, picture in zip(self._publishers, ("left", "right"), self._pictures, strict=True):
            publisher.publish(Image(f"camera_{side}", picture, stamp_ns=number))
        told = calibration_of(PINHOLE, PINHOLE, STILL, STILL)
        return StereoPair(stamp_ns=number, capture_id=number, calibration=told, exposure_s=0.01)


def test_the_answer_warns_and_the_service_tells_it_once() -> None:
    hub, cell = MemoryHub(), load_cell("deploy/cells/default.yaml")
    buses = {name: Bus(hub.transport(), cell.workcell.name, name) for name in ("hardware", "vision", "operator")}
    told: list[Event] = []
    heard = threading.Event()

    def hear(event: Event) -> None:
        told.append(event)
        heard.set()

    buses["operator"].subscribe(EVENTS, hear)
    BentCamera(buses["hardware"])
    shell = VisionShell(ServiceContext("vision", cell, buses["vision"]), VisionConfig(looks=1))
    try:
        first, second = (buses["operator"].call(LOCATE, LocateHole(), 60.0) for _ in range(2))
        assert heard.wait(10.0)
    finally:
        shell.close()
        for bus in buses.values():
            bus.close()
    for seen in (first, second):
        assert "lens is not as calibrated" in seen.warnings[0] and "calibrate the distortion" in seen.warnings[0]
        assert seen.diagnostics["bow_sure"] == 1.0 and abs(seen.diagnostics["bow_k1"] + 0.07) < 0.04
        off = seen.pose_base_hole.pose().inverse() @ TRUTH
        error = np.concatenate([off.translation_m, off.rotvec_rad()])
        assert error @ np.linalg.solve(np.asarray(seen.covariance).reshape(6, 6), error) < 27.86
    lens = [event for event in told if event.code == "lens_not_as_calibrated"]
    assert len(lens) == 1 and lens[0].severity is Severity.WARNING and lens[0].text == first.warnings[0]
