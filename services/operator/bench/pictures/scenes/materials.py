"""Surfaces, as the path tracer takes them: matt, painted and plastic, metals by finish, anodised, paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from services.operator.bench.pictures.scenes.finishes import FloatTexture, blotches, heights_of
from services.operator.bench.pictures.tracing.renderer import mitsuba

Surface = dict[str, Any]


def grey(value: float) -> Surface:
    """A grey, 0..1, the same everywhere."""
    return {"type": "rgb", "value": float(value)}


def textured(values: FloatTexture) -> Surface:
    """A grey that varies: (n, n), linear."""
    mi = mitsuba()

    bitmap = mi.Bitmap(np.ascontiguousarray(values[..., None], dtype=np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "mirror"}


def both_sides(surface: Surface) -> Surface:
    """The surface seen from either side."""
    return {"type": "twosided", "inner": surface}


def matt(level: float, factor: FloatTexture | None = None) -> Surface:
    """A diffuse grey, times a texture if given."""
    values = grey(level) if factor is None else textured(np.clip(level * factor, 0.0, 0.95))
    return both_sides({"type": "diffuse", "reflectance": values})


def plastic(level: float, roughness: float, factor: FloatTexture | None = None) -> Surface:
    """Paint or plastic: a grey under a clear skin of some roughness."""
    values = grey(level) if factor is None else textured(np.clip(level * factor, 0.0, 0.95))
    return both_sides(
        {"type": "roughplastic", "distribution": "ggx", "alpha": roughness, "diffuse_reflectance": values,
         "nonlinear": True}
    )  # fmt: skip


def metal(
    level: float, roughness: tuple[float, float], dull: float = 0.0, factor: FloatTexture | None = None,
    heights_m: FloatTexture | None = None,
) -> Surface:  # fmt: skip
    """A metal whose mirror reflects `level`, rough along u and v, `dull` of it diffuse; heights bend its normals."""
    values = grey(level) if factor is None else textured(np.clip(level * factor, 0.0, 1.0))
    shiny: Surface = {
        "type": "roughconductor", "material": "none", "distribution": "ggx", "specular_reflectance": values,
        "alpha_u": roughness[0], "alpha_v": roughness[1],
    }  # fmt: skip
    if dull:
        flat = {"type": "diffuse", "reflectance": grey(0.6 * level)}
        shiny = {"type": "blendbsdf", "weight": float(dull), "first": shiny, "second": flat}
    if heights_m is not None:
        shiny = {"type": "bumpmap", "arbitrary": textured(heights_m), "scale": 1.0, "inner": shiny}
    return both_sides(shiny)


def machined(finish: str, rng: np.random.Generator, factor: FloatTexture | None = None) -> Surface:
    """A metal face by its finish: roughness, slopes and grey drawn within what the finish gives."""
    low, high, slope, dull = {
        "milled": (0.12, 0.30, 0.05, 0.10),
        "ground": (0.08, 0.25, 0.06, 0.05),
        "turned": (0.10, 0.28, 0.05, 0.08),
        "cast": (0.35, 0.55, 0.12, 0.40),
        "blasted": (0.35, 0.50, 0.10, 0.25),
    }[finish]
    rough = rng.uniform(low, high)
    ratio = rng.uniform(1.5, 3.0) if finish == "ground" else rng.uniform(0.8, 1.25)
    pair = (rough, min(0.7, rough * ratio))
    if rng.random() < 0.5:
        pair = pair[::-1]
    heights = heights_of(finish, slope * rng.uniform(0.4, 1.3), rng)
    wander = blotches(rng, rng.uniform(0.01, 0.06), rng.uniform(0.0, 0.05))
    return metal(rng.uniform(0.45, 0.9), pair, dull * rng.uniform(0.3, 1.5),
                 wander if factor is None else wander * factor, heights)  # fmt: skip


def cut_metal(rng: np.random.Generator, level: float) -> Surface:
    """A cut edge or a bore's wall: metal again, by another tool."""
    return metal(level, (rng.uniform(0.12, 0.35), rng.uniform(0.2, 0.45)), rng.uniform(0.1, 0.4))
