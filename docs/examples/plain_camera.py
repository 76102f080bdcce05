"""A stereo camera for a crosspih cell in plain Zenoh: it imports nothing of crosspih, and docs/wire.md is all it knows.

    python docs/examples/plain_camera.py --cell cell1 --endpoint tcp/127.0.0.1:7447

Serves `camera/capture`, publishes `camera/calibration` and both pictures, and declares the tokens of the camera. It
draws a dark square that hovers 0.4 m before the left camera; put your own pictures where `draw` is called.
"""

from __future__ import annotations

import argparse
import json
import queue
import signal
import sys
import uuid
from typing import Any

import numpy as np
import zenoh
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from zenoh import ext

WIDTH, HEIGHT, F_PX, BASELINE_M, SQUARE_M, DEPTH_M, EXPOSURE_S = 640, 480, 381.36, 0.05, 0.06, 0.4, 0.02
CAMERA = {
    "width_px": WIDTH, "height_px": HEIGHT, "fx_px": F_PX, "fy_px": F_PX, "cx_px": 319.5, "cy_px": 239.5,
    "distortion_model": "none", "distortion": [], "gamma": "linear",
}  # fmt: skip
CALIBRATION = {
    "left": CAMERA, "right": CAMERA,
    # where the right camera stands in the left one's frame
    "pose_left_right": {"position_m": [BASELINE_M, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    # where the left camera stands in the base frame: z forward, x right, y down
    "pose_base_camera": {"position_m": [0.131, -0.2406, 0.2225], "quaternion_xyzw": [-0.5, 0.5, -0.5, 0.5]},
}  # fmt: skip


def draw(offset_m: float) -> np.ndarray:
    """A dark square on a bright plate as a camera sees it that stands `offset_m` to the right, (HEIGHT, WIDTH)."""
    half, centre_u = 0.5 * F_PX * SQUARE_M / DEPTH_M, 319.5 - F_PX * offset_m / DEPTH_M
    # the share of each pixel that the square covers; integers are pixel centres
    across = np.clip(half + 0.5 - np.abs(np.arange(WIDTH) - centre_u), 0.0, 1.0)
    down = np.clip(half + 0.5 - np.abs(np.arange(HEIGHT) - 239.5), 0.0, 1.0)
    return np.round(200.0 - 160.0 * np.outer(down, across)).astype(np.uint8)


class Camera:
    """The camera on the bus."""

    def __init__(self, session: zenoh.Session, cell: str) -> None:
        self._session, self._root = session, f"crosspih/{cell}/"
        # what is said below camera/ is this session's to say: its publishers put the session into each sample
        claim = f"{self._root}service/camera/author/{uuid.uuid4().hex}/{session.zid()}"
        self._claim = session.liveliness().declare_token(claim)
        self._publishers: dict[str, tuple[Any, list[int]]] = {}
        self._now_ns = self._last_ns = self._captures = 0
        # the cell's clock is a state: history gives a late joiner the newest tick at once
        newest = ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        self._clock = ext.declare_advanced_subscriber(session, self._root + "clock", self._tick, history=newest)
        self.queries: queue.Queue[zenoh.Query] = queue.Queue()
        self._queryable = session.declare_queryable(self._root + "camera/capture", self.queries.put, complete=True)
        self.publish("camera/calibration", "crosspih.CameraCalibration/1", CALIBRATION)
        self._token = session.liveliness().declare_token(self._root + "service/camera/alive")

    def _tick(self, sample: zenoh.Sample) -> None:
        self._now_ns = int(json.loads(sample.payload.to_bytes())["stamp_ns"])

    def publish(self, path: str, label: str, value: dict[str, Any] | RawImage, stamp_ns: int | None = None) -> None:
        """Send one sample with its label and number; states and events by advanced publishers, which cache."""
        if path not in self._publishers:
            publisher = ext.declare_advanced_publisher(
                self._session, self._root + path, cache=ext.CacheConfig(64), publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
            )  # fmt: skip
            self._publishers[path] = publisher, [0]
        publisher, count = self._publishers[path]
        if isinstance(value, RawImage):
            payload = value.SerializeToString()
        else:
            stamp = self._now_ns if stamp_ns is None else stamp_ns
            payload = json.dumps({**value, "stamp_ns": stamp, "seq": count[0]}).encode()
        publisher.put(payload, attachment=f"{label} {count[0]}".encode())
        count[0] += 1

    def answer(self, query: zenoh.Query) -> None:
        """Exactly one reply: the pair that was taken, or a refusal."""
        label = query.attachment.to_string() if query.attachment is not None else "no label"
        try:
            if label.split(" ")[0] != "crosspih.CaptureStereo/1":
                raise ValueError(f"got {label}, want crosspih.CaptureStereo/1")
            request = json.loads(query.payload.to_bytes() if query.payload is not None else b"{}")
            self.publish("camera/capture/request", "crosspih.CaptureStereo/1", request)
            reply = self.capture()
        except ValueError as error:
            query.reply_err(f"contract\ncamera/capture: {error}".encode())
        else:
            self.publish("camera/capture/reply", "crosspih.StereoPair/1", reply, reply["stamp_ns"])
            query.reply(query.key_expr, json.dumps(reply).encode(), attachment=b"crosspih.StereoPair/1")
        query.drop()

    def capture(self) -> dict[str, Any]:
        """Send both pictures, then say which they are: by their stamp, which no other pair has."""
        self._last_ns = stamp_ns = max(self._now_ns, self._last_ns + 1)
        for side, offset_m in (("left", 0.0), ("right", BASELINE_M)):
            data = draw(offset_m).tobytes()
            image = RawImage(
                frame_id=f"camera_{side}", width=WIDTH, height=HEIGHT, encoding="mono8", step=WIDTH, data=data
            )
            image.timestamp.FromNanoseconds(stamp_ns)
            self.publish(f"camera/{side}/image", "foxglove.RawImage/1", image)
        self._captures += 1
        calibration = {**CALIBRATION, "stamp_ns": stamp_ns}
        return {
            "stamp_ns": stamp_ns, "capture_id": self._captures, "calibration": calibration, "exposure_s": EXPOSURE_S,
        }  # fmt: skip


def main() -> None:
    """Serve until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description="A stereo camera in plain Zenoh.")
    parser.add_argument("--cell", default="cell1")
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447")
    given = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: sys.exit(0))
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([given.endpoint]))
    config.insert_json5("transport/link/tx/lease", "800")  # ms without a sign of life: then it counts as gone
    with zenoh.open(config) as session:
        camera = Camera(session, given.cell)
        print(f"camera: serves crosspih/{given.cell}/camera/capture", flush=True)
        while True:
            camera.answer(camera.queries.get())


if __name__ == "__main__":
    main()
