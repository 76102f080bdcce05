"""The pictures of one capture against the published calibration of the cameras. Pure."""

from __future__ import annotations

import numpy as np

from crosspih_common.messages import CameraCalibration, Image, StereoPair
from services.operator.cli.rows import Row, ok, wrong


def check_image(side: str, image: Image | None, pair: StereoPair, rejected: str) -> Row:
    """One side: present, stamped like the reply, with the size and frame of the calibration. `rejected`: why a picture
    of it could not be read, if one could not.
    """
    name = f"{side} image"
    if rejected:
        return wrong(name, rejected[:300], "encode it as docs/wire.md says: mono8, mono16, rgb8, bgr8 or bayer")
    if image is None:
        return wrong(
            name,
            "no picture came for the capture",
            f"publish camera/{side}/image before the reply, stamped as the reply is",
        )
    if image.stamp_ns != pair.stamp_ns:
        return wrong(
            name,
            f"stamped {(image.stamp_ns - pair.stamp_ns) * 1e-9:+.4f} s from the reply that names it",
            "both pictures and the reply carry one stamp: that of the exposure",
        )
    height, width = image.pixels.shape[:2]
    wanted = pair.calibration.left if side == "left" else pair.calibration.right
    if (width, height) != (wanted.width_px, wanted.height_px):
        swapped = ": width and height are exchanged" if (height, width) == (wanted.width_px, wanted.height_px) else ""
        return wrong(
            name,
            f"{width} x {height}, the calibration says {wanted.width_px} x {wanted.height_px}{swapped}",
            "calibrate at the size that is sent: focal length and centre are in its pixels",
        )
    if image.frame != f"camera_{side}":
        return wrong(name, f"frame_id {image.frame!r}", f"frame_id: camera_{side}")
    return ok(name, f"{width} x {height} {image.encoding}")


def check_pair(left: Image | None, right: Image | None, pair: StereoPair, told: CameraCalibration | None) -> Row:
    """The two sides compared with each other, and the reply's calibration with the published one."""
    name = "stereo pair"
    if told is None:
        return wrong(name, "camera/calibration was never told", "publish camera/calibration once, at the start")
    unstamped = {"stamp_ns", "seq"}
    if told.model_dump(exclude=unstamped) != pair.calibration.model_dump(exclude=unstamped):
        return wrong(
            name,
            "the reply's calibration is not the published one",
            "tell one calibration, and publish it when it changes",
        )
    if left is not None and right is not None and np.array_equal(left.pixels, right.pixels):
        return wrong(name, "left and right are the same picture", "send each camera's own picture")
    apart_m = float(np.linalg.norm(pair.calibration.pose_left_right.position_m))
    cameras = (pair.calibration.left, pair.calibration.right)
    lens = "" if all(any(one.distortion) for one in cameras) else "; no distortion is told, vision doubts the lens"
    return ok(name, f"baseline {apart_m * 1e3:.1f} mm, exposure {pair.exposure_s * 1e3:.3g} ms{lens}")
