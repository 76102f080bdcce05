"""One scene from its seed to light on two image planes, exposed as a workshop's camera would be."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import CrosspihError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.bench.pictures.camera.cameras import Pair
from services.operator.bench.pictures.kept.store import MAX_SHARE, Rendered
from services.operator.bench.pictures.scenes.scene import MadeScene, SceneSpec, covered, make
from services.operator.bench.pictures.tracing.tracer import LightLevel, Tracer, TraceWindow, draw_levels, window_around

MIN_HIDDEN, MAX_HIDDEN = 0.05, 0.34
TRIES = 40


@dataclass(frozen=True, slots=True)
class Care:
    """Pixels of the fine level for one of the camera's, and samples a pixel."""

    density: int = 2
    samples: int = 36


def windows_for(
    made: MadeScene, pose_world_camera: Pose, focal_px: float, field: Array, care: Care
) -> list[TraceWindow]:
    """Coarse, plate and fine windows of one camera. `field` (n, 2) are normalised places that its picture reaches."""
    into = pose_world_camera.inverse()

    def seen(points_m: Array) -> Array:
        points = into.apply(points_m)
        return np.asarray(points[:, :2] / points[:, 2:3])

    plate = np.clip(seen(made.plate_m), field.min(axis=0), field.max(axis=0))
    return [
        window_around(field, focal_px / 4.0, 2.0, care.samples),
        window_around(plate, focal_px, 5.0, care.samples),
        window_around(seen(made.rim_m), focal_px * care.density, 9.0 * care.density, care.samples),
    ]


def field_of(pair: Pair) -> list[Array]:
    """The normalised places (n, 2) of each camera's picture border, the distortion undone."""
    fields = []
    for lens in pair.lenses:
        w, h = lens.width_px - 0.5, lens.height_px - 0.5
        u, v = np.linspace(-0.5, w, 9), np.linspace(-0.5, h, 9)
        border = np.array([*((x, y) for x in u for y in (-0.5, h)), *((x, y) for x in (-0.5, w) for y in v)])
        at = (border - [lens.cx_px, lens.cy_px]) / [lens.fx_px, lens.fy_px]
        fields.append(1.3 * at if lens.distortion_model == "none" else lens.undistorted(at))
    return fields


def render(spec: SceneSpec, workcell: Workcell, pair: Pair, seed: int, care: Care) -> Rendered:
    """The light of a scene, as a share of full scale at its own exposure. Raises CrosspihError without the renderer."""
    with tempfile.TemporaryDirectory() as folder:
        made, tracer = _visible(spec, workcell, pair, seed, Path(folder))
        eyes = (Pose.identity(), pair.pose_left_right)
        sides = [
            draw_levels(tracer, eye, windows_for(made, eye, lens.fx_px, field, care), (16 * seed + 8 * side) % 2**31)
            for side, (eye, lens, field) in enumerate(zip(eyes, pair.lenses, field_of(pair), strict=True))
        ]
    scale = _exposure(made, sides, eyes, np.random.default_rng([seed, 21]), spec)
    left, right = (tuple(_finished(level, scale, index == 0) for index, level in enumerate(side)) for side in sides)
    return Rendered(left, right, made.truth)


def _visible(spec: SceneSpec, workcell: Workcell, pair: Pair, seed: int, folder: Path) -> tuple[MadeScene, Tracer]:
    """The scene; with something in front of the rim, the first draw that hides a part of it, a third at most."""
    for attempt in range(TRIES if spec.cover else 1):
        made = make(spec, workcell, pair, seed + 1_000_003 * attempt if attempt else seed, folder)
        tracer = Tracer(made.parts)
        hidden = [tracer.hidden(eye, made.rim_m) for eye in (np.zeros(3), pair.pose_left_right.translation_m)]
        shares = [float(np.mean(one)) for one in hidden]
        if not spec.cover or (max(shares) <= MAX_HIDDEN and max(shares) >= MIN_HIDDEN):
            break
    else:
        raise CrosspihError(f"seed {seed}: no {spec.cover} covers {MIN_HIDDEN:.0%} to {MAX_HIDDEN:.0%} of the rim")
    return covered(made, hidden), tracer


def _exposure(
    made: MadeScene, sides: list[list[LightLevel]], eyes: tuple[Pose, Pose], rng: np.random.Generator, spec: SceneSpec
) -> float:
    """What light is full scale: the face about the hole comes to a grey that a person would set."""
    values = []
    for side, eye in zip(sides, eyes, strict=True):
        points = eye.inverse().apply(made.face_m)
        fine = side[-1]
        columns = points[:, 0] / points[:, 2] * fine.focal_px - fine.left - 0.5
        rows = points[:, 1] / points[:, 2] * fine.focal_px - fine.top - 0.5
        at = np.stack([columns, rows], axis=-1).astype(np.float32)[None]
        smooth = cv2.GaussianBlur(fine.light, (0, 0), 2.0)
        values.append(cv2.remap(smooth, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    face = np.concatenate(values, axis=None)
    even = spec.light in ("soft", "box", "dome")
    level = float(np.percentile(face, 60.0 if even else 80.0))
    target = rng.uniform(0.4, 0.75)
    if spec.surface in ("black", "anodised"):
        target = rng.uniform(0.15, 0.5)
    return target / max(level, 1e-6)


def _finished(level: LightLevel, scale: float, coarse: bool) -> LightLevel:
    light = np.minimum(level.light * np.float32(scale), np.float32(MAX_SHARE))
    if coarse:
        # far from the rim few samples do: a filter that keeps edges takes what they scatter
        root = np.asarray(np.sqrt(light), dtype=np.float32)
        middle = np.asarray(cv2.medianBlur(root, 3), dtype=np.float32)
        root = np.where(np.abs(root - middle) > 0.25 * (middle + 0.1), middle, root)
        for _ in range(2):
            root = np.asarray(cv2.bilateralFilter(root, 5, 0.15, 1.5), dtype=np.float32)
        light = root**2
    return LightLevel(level.focal_px, level.left, level.top, light)
