"""Lights of a workshop, in the left camera's frame; each gives the hole's face an irradiance of about pi."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.geometry.pose import Array
from services.operator.bench.pictures.scenes.materials import grey
from services.operator.bench.pictures.tracing.renderer import mitsuba
from services.operator.bench.pictures.tracing.solids import disc, flat

LIGHTS = ("soft", "box", "dome", "strip", "ring", "side", "lamp")
Emitters = dict[str, Any]


def _turned_to(at_m: Array, target_m: Array, half_m: tuple[float, float], roll_rad: float) -> Any:
    mi = mitsuba()

    up = np.array([np.sin(roll_rad), np.cos(roll_rad), 0.0])
    frame = mi.ScalarTransform4f()
    return frame.look_at(list(map(float, at_m)), list(map(float, target_m)), list(map(float, up))) @ frame.scale(
        [half_m[0], half_m[1], 1.0]
    )


def panel(
    at_m: Array,
    target_m: Array,
    half_m: tuple[float, float],
    normal: Array,
    strength: float = 1.0,
    roll_rad: float = 0.0,
) -> Emitters:
    """A rectangle that shines at a point whose surface has a normal."""
    ray = np.asarray(at_m) - target_m
    distance = float(np.linalg.norm(ray))
    cosine = max(float(ray @ normal) / distance, 0.1)
    radiance = strength * np.pi * distance**2 / (4.0 * half_m[0] * half_m[1] * cosine)
    return {
        "type": "rectangle", "to_world": _turned_to(at_m, target_m, half_m, roll_rad),
        "bsdf": {"type": "diffuse", "reflectance": grey(0.3)},
        "emitter": {"type": "area", "radiance": grey(radiance)},
    }  # fmt: skip


def around(strength: float) -> Emitters:
    """The room's own light, from everywhere."""
    return {"type": "constant", "radiance": grey(strength)}


def dome(rng: np.random.Generator, strength: float) -> Emitters:
    """Light from everywhere that is not the same everywhere: a gradient, and dark or bright patches."""
    mi = mitsuba()
    from scipy.ndimage import gaussian_filter

    sky = np.ones((32, 64))
    patches = gaussian_filter(rng.standard_normal(sky.shape), 3.0, mode="wrap")
    sky += rng.uniform(0.1, 0.3) * patches / patches.std()
    sky += rng.uniform(-0.3, 0.3) * np.linspace(-1.0, 1.0, 32)[:, None]
    sky = strength * np.clip(sky, 0.15, None)
    bitmap = mi.Bitmap(np.repeat(sky[..., None], 3, axis=2).astype(np.float32))
    return {"type": "envmap", "bitmap": bitmap}


def make_lights(kind: str, hole_m: Array, normal: Array, folder: Path, rng: np.random.Generator) -> Emitters:
    """Emitters by name. `hole_m` is the hole, `normal` the face's outward normal, in the left camera's frame."""
    made: Emitters = {}
    eyes = np.array([0.025, 0.0, 0.0])
    if kind == "soft":
        # a big screen beside or above the cameras, and a bright room
        at = np.array([rng.uniform(-0.35, 0.35), rng.uniform(-0.45, 0.1), rng.uniform(-0.25, 0.0)])
        made["panel"] = panel(at, hole_m, (rng.uniform(0.12, 0.25), rng.uniform(0.12, 0.25)), normal, 0.8)
        made["room"] = around(rng.uniform(0.1, 0.4))
    elif kind == "box":
        # a soft box where the plate mirrors it into the cameras
        view = (hole_m - eyes) / np.linalg.norm(hole_m - eyes)
        mirrored = view - 2.0 * (view @ normal) * normal
        at = hole_m + mirrored * rng.uniform(0.35, 0.5) + rng.uniform(-0.05, 0.05, 3) * [1, 1, 0]
        at[2] = min(at[2], -0.06)
        made["panel"] = panel(at, hole_m, (rng.uniform(0.18, 0.32), rng.uniform(0.18, 0.32)), normal, 0.9)
        made["room"] = around(rng.uniform(0.03, 0.15))
    elif kind == "dome":
        made["room"] = dome(rng, 1.0)
    elif kind == "strip":
        turn = rng.uniform(0.0, 2.0 * np.pi)
        at = hole_m + np.array([0.22 * np.cos(turn), 0.22 * np.sin(turn), 0.0]) * rng.uniform(0.5, 1.2)
        at[2] = rng.uniform(-0.15, -0.02)
        half = (rng.uniform(0.012, 0.03), rng.uniform(0.15, 0.25))
        made["panel"] = panel(at, hole_m, half, normal, 0.9, rng.uniform(0.0, np.pi))
        made["room"] = around(rng.uniform(0.02, 0.08))
    elif kind == "ring":
        inner = rng.uniform(0.042, 0.06)
        band = disc(inner + rng.uniform(0.012, 0.025), 48, (0.025, 0.0)) - disc(inner, 48, (0.025, 0.0))
        path = folder / "ring.ply"
        flat(band, -0.002, 1.0).write(path)
        radiance = 0.9 * np.pi * float(hole_m @ hole_m) / float(band.area)
        made["ring"] = {
            "type": "ply", "filename": str(path), "bsdf": {"type": "diffuse", "reflectance": grey(0.3)},
            "emitter": {"type": "area", "radiance": grey(radiance)},
        }  # fmt: skip
        made["room"] = around(rng.uniform(0.02, 0.1))
    elif kind == "side":
        turn = rng.uniform(0.0, 2.0 * np.pi)
        at = hole_m + rng.uniform(0.3, 0.5) * np.array([np.cos(turn), np.sin(turn), 0.0])
        at[2] = hole_m[2] - rng.uniform(0.08, 0.25)
        made["panel"] = panel(at, hole_m, (rng.uniform(0.03, 0.08), rng.uniform(0.03, 0.08)), normal, 0.8)
        made["room"] = around(rng.uniform(0.05, 0.2))
    else:
        # one small lamp of the machine, hard shadows
        at = np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.4, 0.0), rng.uniform(-0.3, -0.05)])
        made["panel"] = panel(at, hole_m, (0.02, 0.02), normal, 0.8)
        made["room"] = around(rng.uniform(0.05, 0.25))
    return made
