"""`crosspih recording export rerun`: a recording for the Rerun viewer, as an .rrd file."""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from rich.console import Console

from crosspih_common.errors import ConfigError
from crosspih_common.foxglove import schemas
from crosspih_common.foxglove.frames import BASE
from crosspih_common.keys import CAMERA_CALIBRATION, CONTACT_WRENCH, IMAGE_LEFT, IMAGE_RIGHT, JOINT_STATE, WRENCH_RAW
from crosspih_common.messages import CameraCalibration, Frame, Image
from crosspih_common.recording import Recording, read_recording
from services.operator.bench.options import errors_shown
from services.operator.recordings.export.shown import EVERY, cell_of, shown_of

TIMELINE = "cell_time"
ROOT = "cell"
LEVELS = {Log.INFO: "INFO", Log.WARNING: "WARN", Log.ERROR: "ERROR"}
SIDES = (("left", IMAGE_LEFT), ("right", IMAGE_RIGHT))
AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")


def rerun(
    recording: Annotated[Path, typer.Argument(help="A recording (.mcap), also a torn or damaged one.")],
    out: Annotated[Path, typer.Argument(help="The file that is made (.rrd).")],
) -> None:
    """Write a recording for the Rerun viewer: the cell in 3-D, pictures, forces at full rate, joints, log."""
    console = Console()
    with errors_shown(console):
        if out.exists():
            raise ConfigError(f"{out}: is there already; name a file that is not")
        read = read_recording(recording, {*EVERY, IMAGE_LEFT, IMAGE_RIGHT})
        for name, count in sorted(write_rrd(read, out).items()):
            console.print(f"{count:8d}  {name}", highlight=False)


def write_rrd(recording: Recording, out: Path) -> Counter[str]:
    """Write the file; returns how many rows each entity has. Raises ConfigError without rerun-sdk, or where the
    recording names no cell.
    """
    try:
        import rerun as rr
    except ImportError:
        raise ConfigError("this needs rerun-sdk: pip install 'crosspih[rerun]'") from None
    stream: Any = rr.RecordingStream(f"crosspih {recording.cell}")
    stream.save(str(out))
    return _Writer(rr, stream, recording).write()


class _Writer:
    """Writes a recording to a Rerun stream: frames as a tree of entities, bodies fixed to a frame below it."""

    def __init__(self, rr: Any, stream: Any, recording: Recording) -> None:
        self._rr, self._stream, self._recording = rr, stream, recording
        self._mounting = cell_of(recording).workcell.sensor_mounting().peg_of_raw
        base = f"{ROOT}/{BASE}"
        left = f"{base}/{Frame.CAMERA_LEFT.value}"
        self._paths = {
            BASE: base, Frame.CAMERA_LEFT.value: left,
            Frame.CAMERA_RIGHT.value: f"{left}/{Frame.CAMERA_RIGHT.value}",
        }  # fmt: skip
        self._placed: dict[str, bytes] = {}  # the last value of each frame, without its stamp
        self._counts: Counter[str] = Counter()
        self._entities: dict[str, set[str]] = defaultdict(set)  # for each topic, the messages that were logged

    def write(self) -> Counter[str]:
        rr = self._rr
        self._stream.log(ROOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.send_blueprint(self._layout())
        self._cameras()
        self._numbers()
        take = {
            "foxglove.FrameTransforms": self._frames,
            "foxglove.SceneUpdate": self._scene,
            "foxglove.PosesInFrame": self._path,
            "foxglove.Log": self._log_line,
        }
        for shown in shown_of(self._recording):
            method = take.get(shown.topic.schema)
            if method is not None:
                self._stream.set_time(TIMELINE, duration=shown.stamp_ns * 1e-9)
                method(shown.topic, shown.data)
        self._stream.flush()
        return self._counts

    def _layout(self) -> Any:
        import rerun.blueprint as rrb

        pictures = [
            rrb.Spatial2DView(origin=self._path_of(f"camera_{side}") + "/picture", name=f"{side} picture")
            for side, _ in SIDES
        ]
        beside = rrb.Vertical(
            rrb.Horizontal(*pictures), rrb.TimeSeriesView(origin="wrench/contact", name="contact, N and Nm"),
            rrb.TimeSeriesView(origin="wrench/raw", name="the sensor at full rate, N and Nm"),
            rrb.TextLogView(origin="log", name="log"),
        )  # fmt: skip
        return rrb.Blueprint(rrb.Horizontal(rrb.Spatial3DView(origin=ROOT, name="cell"), beside), collapse_panels=True)

    def _put(self, path: str, what: Any) -> None:
        self._stream.log(path, what)
        self._counts[path] += 1

    def _path_of(self, frame: str) -> str:
        return self._paths.get(frame, f"{ROOT}/{frame}")

    def _frames(self, topic: schemas.ViewerTopic, data: bytes) -> None:
        for one in FrameTransforms.FromString(data).transforms:
            path = self._paths.setdefault(
                one.child_frame_id, f"{self._path_of(one.parent_frame_id)}/{one.child_frame_id}"
            )
            one.ClearField("timestamp")
            told = one.SerializeToString()
            if self._placed.get(path) == told:
                continue
            self._placed[path] = told
            place, turn = one.translation, one.rotation
            self._put(path, self._rr.Transform3D(
                translation=[place.x, place.y, place.z], quaternion=[turn.x, turn.y, turn.z, turn.w],
            ))  # fmt: skip

    def _scene(self, topic: schemas.ViewerTopic, data: bytes) -> None:
        rr = self._rr
        now: set[str] = set()
        for entity in SceneUpdate.FromString(data).entities:
            below = f"{self._path_of(entity.frame_id)}/{entity.id}"
            parts: dict[str, Any] = {}
            for index, mesh in enumerate(entity.triangles):
                corners = np.array([[p.x, p.y, p.z] for p in mesh.points])
                triangles = np.array(mesh.indices).reshape(-1, 3)
                flat = corners[triangles].reshape(-1, 3)  # each triangle has its own corners, so that edges stay sharp
                a, b, c = flat[0::3], flat[1::3], flat[2::3]
                normals = np.repeat(np.cross(b - a, c - a), 3, axis=0)
                parts[f"mesh{index}"] = rr.Mesh3D(
                    vertex_positions=flat, triangle_indices=np.arange(len(flat)).reshape(-1, 3),
                    vertex_normals=normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12),
                    albedo_factor=_rgba(mesh.color),
                )  # fmt: skip
            if entity.spheres:
                parts["balls"] = rr.Ellipsoids3D(
                    centers=[_xyz(one.pose.position) for one in entity.spheres],
                    half_sizes=[[one.size.x / 2, one.size.y / 2, one.size.z / 2] for one in entity.spheres],
                    quaternions=[_quaternion(one.pose.orientation) for one in entity.spheres],
                    colors=[_rgba(one.color) for one in entity.spheres], fill_mode="solid",
                )  # fmt: skip
            if entity.cylinders:
                parts["cylinders"] = rr.Cylinders3D(
                    lengths=[one.size.z for one in entity.cylinders],
                    radii=[one.size.x / 2 for one in entity.cylinders],
                    centers=[_xyz(one.pose.position) for one in entity.cylinders],
                    quaternions=[_quaternion(one.pose.orientation) for one in entity.cylinders],
                    colors=[_rgba(one.color) for one in entity.cylinders], fill_mode="solid",
                )  # fmt: skip
            if entity.cubes:
                parts["boxes"] = rr.Boxes3D(
                    half_sizes=[[one.size.x / 2, one.size.y / 2, one.size.z / 2] for one in entity.cubes],
                    centers=[_xyz(one.pose.position) for one in entity.cubes],
                    quaternions=[_quaternion(one.pose.orientation) for one in entity.cubes],
                    colors=[_rgba(one.color) for one in entity.cubes], fill_mode="solid",
                )  # fmt: skip
            if entity.arrows:
                parts["arrows"] = rr.Arrows3D(
                    origins=[_xyz(one.pose.position) for one in entity.arrows],
                    vectors=[_along_x(one) for one in entity.arrows],
                    radii=[one.shaft_diameter / 2 for one in entity.arrows],
                    colors=[_rgba(one.color) for one in entity.arrows],
                )  # fmt: skip
            if entity.lines:
                strips = [[_xyz(p) for p in (*line.points, line.points[0])] for line in entity.lines]
                parts["lines"] = rr.LineStrips3D(
                    strips, radii=[line.thickness / 2 for line in entity.lines],
                    colors=[_rgba(line.color) for line in entity.lines],
                )  # fmt: skip
            if entity.texts:
                parts["texts"] = rr.Points3D(
                    [_xyz(one.pose.position) for one in entity.texts], labels=[one.text for one in entity.texts],
                    radii=0.0005, colors=[_rgba(one.color) for one in entity.texts],
                )  # fmt: skip
            for name, part in parts.items():
                self._put(f"{below}/{name}", part)
                now.add(f"{below}/{name}")
        for gone in self._entities[topic.name] - now:
            self._stream.log(gone, rr.Clear(recursive=False))
        self._entities[topic.name] = now

    def _path(self, topic: schemas.ViewerTopic, data: bytes) -> None:
        message = PosesInFrame.FromString(data)
        way = [[pose.position.x, pose.position.y, pose.position.z] for pose in message.poses]
        name = topic.name.rsplit("/", 1)[-1]
        below = f"{self._path_of(message.frame_id)}/path/{name}"
        self._put(below, self._rr.LineStrips3D([way], radii=0.0005) if len(way) > 1 else self._rr.Points3D(way))

    def _log_line(self, topic: schemas.ViewerTopic, data: bytes) -> None:
        line = Log.FromString(data)
        self._put("log", self._rr.TextLog(f"{line.name}: {line.message}", level=LEVELS.get(line.level, "INFO")))

    def _cameras(self) -> None:
        rr, calibration = self._rr, self._recording.last(CAMERA_CALIBRATION)
        for side, topic in SIDES:
            # Rerun draws all below a Pinhole flat in its picture: it has a path that no camera frame is below
            path = self._path_of(f"camera_{side}") + "/picture"
            if isinstance(calibration, CameraCalibration):
                camera = getattr(calibration, side)
                lens = rr.Pinhole(
                    focal_length=[camera.fx_px, camera.fy_px], principal_point=[camera.cx_px, camera.cy_px],
                    resolution=[camera.width_px, camera.height_px], image_plane_distance=0.1,
                )  # fmt: skip
                self._stream.log(path, lens, static=True)
            for image in self._recording.messages(topic):
                self._stream.set_time(TIMELINE, duration=image.stamp_ns * 1e-9)
                self._put(path, self._picture(image))

    def _picture(self, image: Image) -> Any:
        model = {"rgb8": "RGB", "bgr8": "BGR"}.get(image.encoding)
        return self._rr.Image(image.pixels, color_model=model) if model else self._rr.Image(image.pixels)

    def _numbers(self) -> None:
        raw, stamps = [], []
        for batch in self._recording.messages(WRENCH_RAW):
            raw.append(np.asarray(batch.samples) @ self._mounting.T)
            stamps.append(batch.stamp_ns + np.arange(len(batch.samples)) * batch.period_ns)
        if raw:
            self._columns("wrench/raw", np.concatenate(stamps), np.concatenate(raw), AXES)
        felt = self._recording.messages(CONTACT_WRENCH)
        if felt:
            self._columns("wrench/contact", np.array([one.stamp_ns for one in felt]),
                          np.array([one.wrench for one in felt]), AXES)  # fmt: skip
        joints = self._recording.messages(JOINT_STATE)
        if joints:
            angles = np.array([one.joints_rad for one in joints])
            names = tuple(f"joint_{index + 1}_rad" for index in range(angles.shape[1]))
            self._columns("joints", np.array([one.stamp_ns for one in joints]), angles, names)

    def _columns(self, path: str, stamps_ns: Any, rows: Any, names: tuple[str, ...]) -> None:
        rr = self._rr
        times = rr.TimeColumn(TIMELINE, duration=np.asarray(stamps_ns) * 1e-9)
        self._stream.log(path, rr.SeriesLines(names=list(names)), static=True)
        columns = rr.Scalars.columns(scalars=np.asarray(rows).ravel()).partition([len(names)] * len(rows))
        self._stream.send_columns(path, indexes=[times], columns=columns)
        self._counts[path] += len(rows)


def _xyz(point: Any) -> list[float]:
    return [point.x, point.y, point.z]


def _quaternion(turn: Any) -> list[float]:
    return [turn.x, turn.y, turn.z, turn.w]


def _rgba(color: Any) -> list[float]:
    return [color.r, color.g, color.b, color.a]


def _along_x(arrow: Any) -> list[float]:
    """The arrow's own x axis at its full length."""
    x, y, z, w = _quaternion(arrow.pose.orientation)
    length = arrow.shaft_length + arrow.head_length
    return [length * (1 - 2 * (y * y + z * z)), length * 2 * (x * y + z * w), length * 2 * (x * z - y * w)]
