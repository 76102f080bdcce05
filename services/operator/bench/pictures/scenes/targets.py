"""What is in the middle of the plate: the hole as it was made, or something that is no such hole."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from shapely import Polygon
from shapely.affinity import rotate, scale
from shapely.geometry.base import BaseGeometry

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Outline
from crosspih_common.shapes.cross import cross_outline
from services.operator.bench.pictures.scenes.materials import Surface, matt, plastic
from services.operator.bench.pictures.tracing.solids import Solid, SolidRim, disc, flat, prism, walls

Part = tuple[str, Solid, Surface]
MADE = (
    "print_inner", "print_outer", "print_shaded", "sticker", "pocket", "blank", "square", "round", "wide_cross",
    "long_cross", "short_cross", "slot", "plus_one",
)  # fmt: skip
"""What is no such hole. `plus_one` is the cross with one arm too long."""

CORNERS_M: dict[str, list[tuple[float, float]]] = {
    # an L and a T of 44 mm, 16 mm wide
    "ell": [(-0.008, -0.008), (0.036, -0.008), (0.036, 0.008), (0.008, 0.008), (0.008, 0.036), (-0.008, 0.036)],
    "tee": [
        (-0.022, -0.008), (0.022, -0.008), (0.022, 0.008), (0.008, 0.008), (0.008, 0.036), (-0.008, 0.036),
        (-0.008, 0.008), (-0.022, 0.008),
    ],
}  # fmt: skip
"""Outlines of our own, that no peg has by name."""


def peg_of(outline: str) -> dict[str, object]:
    """The section `cell.peg` of a cell's file for an outline of the pictures."""
    if outline in CORNERS_M:
        return {"outline": outline, "corners_m": [list(corner) for corner in CORNERS_M[outline]]}
    return {"outline": outline}


def hole_of(workcell: Workcell, outline: str) -> Hole:
    """The drawing's hole for an outline."""
    if outline == workcell.peg.outline:
        return workcell.hole.shape(workcell.peg.shape())
    peg = type(workcell.peg).model_validate(peg_of(outline))
    return workcell.hole.shape(peg.shape())


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """The face without it, its own parts, and what it takes away from the plate's back."""

    face: BaseGeometry
    solids: list[Part]
    through: list[BaseGeometry] = field(default_factory=list)


def sides_of(plate: Polygon, thickness_m: float) -> Solid:
    """The four sides of the plate."""
    corners = np.array(plate.exterior.coords[:-1])
    if not plate.exterior.is_ccw:
        corners = corners[::-1]
    edges = np.roll(corners, -1, axis=0) - corners
    out = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    rings = [np.column_stack([corners, np.full(len(corners), z)]) for z in (0.0, thickness_m)]
    return walls(rings, [(np.pi / 2.0, np.pi / 2.0)], out)


def put(
    kind: str, rim: SolidRim, area: BaseGeometry, depth_m: float, thickness_m: float,
    surfaces: tuple[Surface, Surface, Surface], through: bool, rng: np.random.Generator,
) -> Target:  # fmt: skip
    """The target of a kind in a face of that area; `surfaces` are the chamfer's, the bore's and the face's."""
    if kind == "blank":
        return Target(area, [])
    if kind.startswith("print") or kind == "sticker":
        return _printed(kind, rim, area, rng)
    if kind == "pocket":
        return _bored(rim, area, float(rng.uniform(0.002, 0.008)), thickness_m, surfaces, False)
    if kind != "hole":
        rim = SolidRim(_other_outline(kind, rim.bore, rng), rim.chamfer_m, rim.edge_break_m)
    return _bored(rim, area, depth_m, thickness_m, surfaces, through)


def _bored(
    rim: SolidRim, area: BaseGeometry, depth_m: float, thickness_m: float, surfaces: tuple[Surface, Surface, Surface],
    through: bool,
) -> Target:  # fmt: skip
    edge, bore = rim.strips(thickness_m if through else depth_m)
    solids: list[Part] = [("rim", edge, surfaces[0]), ("bore", bore, surfaces[1])]
    section = Polygon(rim.bore.corners_m)
    if not through:
        shallow = depth_m < 0.01
        solids.append(("bottom", flat(section, depth_m), surfaces[2] if shallow else surfaces[1]))
    return Target(area - rim.opening(), solids, [section] if through else [])


def _printed(kind: str, rim: SolidRim, area: BaseGeometry, rng: np.random.Generator) -> Target:
    inner, outer = Polygon(rim.bore.corners_m), Polygon(rim.ring_m(rim.chamfer_m, 0.0)[:, :2])
    ink = matt(rng.uniform(0.02, 0.1)) if rng.random() < 0.6 else plastic(0.03, rng.uniform(0.1, 0.3))
    if kind == "sticker":
        shape = inner if rng.random() < 0.5 else outer
        skin = plastic(rng.uniform(0.02, 0.08), rng.uniform(0.05, 0.25))
        return Target(area, [("sticker", prism(shape, -rng.uniform(0.05e-3, 0.25e-3), 0.0), skin)])
    if kind == "print_inner":
        return Target(area - inner, [("ink", flat(inner, 0.0), ink)])
    if kind == "print_outer":
        return Target(area - outer, [("ink", flat(outer, 0.0), ink)])
    # a picture of a hole: chamfer in the greys that a light would give it, walls, a dark bottom
    light = rng.uniform(0.0, 2.0 * np.pi)
    solids: list[Part] = []
    inside, outside = rim.bore.corners_m, rim.ring_m(rim.chamfer_m, 0.0)[:, :2]
    shift = rng.uniform(0.001, 0.006) * np.array([np.cos(light), np.sin(light)])
    bottom = inner.intersection(Polygon(inside + shift))
    for index, normal in enumerate(rim.bore.normals):
        after = (index + 1) % len(inside)
        facet = Polygon([inside[index], inside[after], outside[after], outside[index]])
        level = 0.45 - 0.3 * float(normal @ [np.cos(light), np.sin(light)]) * rng.uniform(0.7, 1.2)
        solids.append((f"ink{index}", flat(facet, 0.0), matt(level)))
    solids.append(("inkwall", flat(inner - bottom, 0.0), matt(rng.uniform(0.1, 0.35))))
    solids.append(("ink", flat(bottom, 0.0), ink))
    return Target(area - outer, solids)


def _other_outline(kind: str, bore: Outline, rng: np.random.Generator) -> Outline:
    w, el = 0.0091, 0.0271
    corners: Array
    if kind == "square":
        side = rng.uniform(0.012, 0.026)
        corners = np.array([(-side, -side), (side, -side), (side, side), (-side, side)])
    elif kind == "round":
        corners = np.array(disc(rng.uniform(0.014, 0.027), 64).exterior.coords[:-1])
    elif kind == "slot":
        length, width = rng.uniform(0.022, 0.03), rng.uniform(0.007, 0.012)
        corners = np.array([(-length, -width), (length, -width), (length, width), (-length, width)])
    elif kind == "wide_cross":
        corners = cross_outline(w + rng.choice([-1.0, 1.0]) * rng.uniform(0.0012, 0.004), el)
    elif kind == "long_cross":
        corners = cross_outline(w, el + rng.uniform(0.002, 0.007))
    elif kind == "short_cross":
        corners = cross_outline(w, el - rng.uniform(0.002, 0.007))
    else:
        corners = cross_outline(w, el).copy()
        corners[:2, 0] += rng.uniform(0.003, 0.008)
    made = Polygon(corners)
    if kind in ("square", "slot"):
        made = rotate(made, rng.uniform(-20.0, 20.0), origin=(0, 0))
    made = scale(made, 1.0, 1.0)
    return Outline.of(kind, np.array(made.exterior.coords[:-1]), 1)
