"""Binds the cores to their keys: take a pair, locate, publish what was seen."""

from __future__ import annotations

import time

from crosspih_common.errors import CommandRefused
from crosspih_common.keys import ANNOTATED_LEFT, ANNOTATED_RIGHT, CAPTURE, IMAGE_LEFT, IMAGE_RIGHT, LOCATE
from crosspih_common.messages import (
    CameraCalibration,
    CaptureStereo,
    Frame,
    HoleEstimate,
    Image,
    LocateHole,
    LocateMethod,
    PoseData,
    Severity,
    StereoPair,
    floats,
)
from crosspih_common.service import ServiceContext
from services.vision.config import VisionConfig
from services.vision.disturbance import disturbed
from services.vision.doubts import doubts_of
from services.vision.light import linear_light
from services.vision.locate import locate_rim
from services.vision.paper import locate_paper
from services.vision.refusals import VisionRefusal
from services.vision.second_look import Lighting, next_look
from services.vision.stereo import StereoModel
from services.vision.straightness import lenses_of

METHODS = {LocateMethod.RIM: locate_rim, LocateMethod.PAPER: locate_paper}


class VisionShell:
    """The service on the bus."""

    def __init__(self, context: ServiceContext, config: VisionConfig) -> None:
        self._context, self._bus, self._config = context, context.bus, config
        workcell = context.cell.workcell
        self._hole = workcell.hole.shape(workcell.peg.shape())
        self._nominal = workcell.hole_prior.pose_base_hole()
        self._half_ranges = workcell.hole_prior.half_ranges()
        self._doubts = doubts_of(workcell.hole.tolerance, config.calibration_doubt)
        self._warned_of: CameraCalibration | None = None
        self._images = self._bus.latest(IMAGE_LEFT, 2), self._bus.latest(IMAGE_RIGHT, 2)
        self._annotated = self._bus.publisher(ANNOTATED_LEFT), self._bus.publisher(ANNOTATED_RIGHT)
        self._bus.serve(LOCATE, self._locate)

    def _capture(self, look: Lighting) -> tuple[StereoPair, list[Image]]:
        command = CaptureStereo(exposure_scale=look.exposure_scale, lamp=look.lamp)
        pair = self._bus.call(CAPTURE, command, self._config.capture_deadline_s)
        pictures = []
        for latest, side in zip(self._images, ("left", "right"), strict=True):
            image = latest.wait_for(lambda sample: sample.stamp_ns == pair.stamp_ns, self._config.image_deadline_s)
            if image is None:
                raise CommandRefused(
                    "no_image", f"the {side} image of capture {pair.capture_id} did not arrive in time; ask again"
                )
            pictures.append(image)
        return pair, pictures

    def _warn(self, calibration: CameraCalibration, warnings: tuple[str, ...]) -> None:
        """Warn about a calibration once, not at each look."""
        if warnings and calibration != self._warned_of:
            self._warned_of = calibration
            self._context.event(Severity.WARNING, "lens_not_as_calibrated", "; ".join(warnings))

    def _locate(self, request: LocateHole) -> HoleEstimate:
        if not self._config.enabled:
            raise CommandRefused("switched_off", "vision.enabled is false in the cell's file")
        look: Lighting | None = Lighting()
        refusals: list[VisionRefusal] = []
        capture_wall_s = 0.0
        while look is not None and len(refusals) < self._config.looks:
            started = time.perf_counter()
            pair, (left, right) = self._capture(look)
            capture_wall_s += time.perf_counter() - started
            stereo = StereoModel.of(pair.calibration, self._config.camera_correction.pose())
            try:
                lights = [
                    linear_light(image.pixels, image.encoding, camera.gamma)
                    for image, camera in zip((left, right), stereo.cameras, strict=True)
                ]
                found = METHODS[request.method](
                    lights[0], lights[1], stereo, self._hole, self._nominal, self._half_ranges, self._doubts
                )
                break
            except VisionRefusal as refusal:
                refusals.append(refusal)
                look = next_look(look, refusal.code, refusal.certain)
        else:
            # a lens that is not as calibrated may be the reason for the refusal
            self._warn(pair.calibration, lenses_of((lights[0], lights[1]), stereo.cameras).warnings())
            told = str(refusals[0])
            if len(refusals) > 1:
                told += f" (and {len(refusals) - 1} more under other light: {', '.join(r.code for r in refusals[1:])})"
            raise CommandRefused(refusals[0].code, told)
        self._warn(pair.calibration, found.warnings)
        found = disturbed(
            found, self._config.extra_noise, left.pixels, right.pixels, request.method is LocateMethod.RIM
        )
        for publisher, frame, picture in zip(
            self._annotated,
            (Frame.CAMERA_LEFT, Frame.CAMERA_RIGHT),
            (found.annotated_left, found.annotated_right),
            strict=True,
        ):
            publisher.publish(Image(frame.value, picture, pair.stamp_ns))
        return HoleEstimate(
            pose_base_hole=PoseData.of(found.pose_base_hole),
            covariance=floats(found.covariance),
            method=request.method,
            orientation_measured=request.method is LocateMethod.RIM,
            capture_id=pair.capture_id,
            capture_wall_s=capture_wall_s,
            diagnostics={
                **found.diagnostics,
                "looks": len(refusals) + 1.0,
                "exposure_scale": look.exposure_scale,
                "lamp": float(look.lamp),
            },
            warnings=found.warnings,
        )

    def close(self) -> None:
        """Nothing to release."""
