"""What stands on, in front of and behind the plate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from shapely import MultiPolygon, Polygon, unary_union
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.cross import cross_outline
from services.operator.bench.pictures.scenes.lights import Emitters, panel
from services.operator.bench.pictures.scenes.materials import Surface, cut_metal, grey, matt, metal, plastic
from services.operator.bench.pictures.tracing.solids import Solid, box_solid, convex_solid, disc, flat, prism, tube

Part = tuple[str, Solid, Surface]
BACKGROUNDS = ("dark", "bright", "clutter", "half")


def on_the_face(rng: np.random.Generator, plate: Polygon, keep_out_m: float) -> tuple[list[Part], BaseGeometry]:
    """Screws, and holes of other outlines beside the one: (parts, what is cut out of the face)."""
    parts: list[Part] = []
    cuts: list[Polygon] = []
    low, high = np.array(plate.bounds[:2]), np.array(plate.bounds[2:])
    room = plate.buffer(-0.004) - disc(keep_out_m + 0.003)
    screw = metal(rng.uniform(0.2, 0.7), (0.15, 0.2), 0.2)
    radius, height = rng.uniform(0.003, 0.0055), rng.uniform(0.0005, 0.005)
    inset = radius + rng.uniform(0.003, 0.006)
    for corner in range(4):
        at = np.where([corner & 1, corner & 2], low + inset, high - inset)
        head = translate(disc(radius), *at)
        if rng.random() < 0.2 or not room.contains(head):
            continue
        socket = translate(rotate(disc(0.5 * radius, 6), rng.uniform(0.0, 60.0)), *at)
        parts.append((f"screw{corner}", prism(head - socket, -height, 0.0), screw))
        parts.append((f"socket{corner}", flat(socket, -0.2 * height), matt(0.05)))
    shapes = [disc(rng.uniform(0.0015, 0.006)) for _ in range(rng.integers(1, 4))]
    shapes.append(disc(rng.uniform(0.006, 0.011), int(rng.choice([4, 6, 40]))))
    if rng.random() < 0.4:
        small = rng.uniform(0.25, 0.45)
        shapes.append(Polygon(cross_outline(0.0091 * small, 0.0271 * small)))
    for index, shape in enumerate(shapes):
        for _ in range(60):
            made = translate(rotate(shape, rng.uniform(0.0, 90.0)), *rng.uniform(low, high))
            if room.contains(made) and not any(made.distance(cut) < 0.002 for cut in cuts):
                cuts.append(made)
                depth = rng.uniform(0.003, 0.02)
                wall = prism(made, 0.0, depth)
                # the prism's own lid is the face's plane: leave it off
                low_lid = np.all(wall.vertices_m[wall.faces, 2] == 0.0, axis=1)
                open_wall = Solid(wall.vertices_m, wall.normals, wall.places, wall.faces[~low_lid])
                parts.append((f"bored{index}", open_wall, cut_metal(rng, rng.uniform(0.1, 0.5))))
                break
    return parts, unary_union(cuts) if cuts else MultiPolygon()


def in_front(kind: str, rng: np.random.Generator, opening_m: Array, workcell: Workcell) -> list[Part]:
    """A bar, a cable or the peg between cameras and rim, over a part of it; in the hole's frame."""
    reach = float(np.hypot(*opening_m.T).max())
    turn = rng.uniform(0.0, 2.0 * np.pi)
    out = np.array([np.cos(turn), np.sin(turn), 0.0])
    side = np.array([-out[1], out[0], 0.0])
    away = -rng.uniform(0.006, 0.04)
    skin = [matt(rng.uniform(0.03, 0.7)), plastic(rng.uniform(0.05, 0.8), 0.2),
            metal(rng.uniform(0.3, 0.8), (0.2, 0.3), 0.2)][int(rng.integers(3))]  # fmt: skip
    if kind == "cable":
        count = 24
        along = np.linspace(-0.11, 0.11, count)
        sway = rng.uniform(0.2, 0.9) * reach + 0.012 * np.sin(along * rng.uniform(20.0, 60.0) + rng.uniform(0.0, 6.0))
        path = along[:, None] * side + sway[:, None] * out + [0.0, 0.0, away]
        return [("cable", tube(path, rng.uniform(0.0015, 0.005)), skin)]
    if kind == "peg":
        peg = workcell.peg.shape()
        tip = rng.uniform(0.9, 2.2) * reach * out + [0.0, 0.0, away]
        # leaning away from the cameras' line of sight
        lean = Pose.from_rotvec(-side * rng.uniform(0.1, 0.7), [0.0, 0.0, 0.0])
        pose = Pose(lean.rotation, tip) @ Pose.from_translation([0.0, 0.0, -peg.tip_m])
        return [("peg", convex_solid(peg.pieces()).at(pose), skin)]
    half = np.array([rng.uniform(0.006, 0.016), rng.uniform(0.03, 0.09), rng.uniform(0.001, 0.006)])
    centre = (rng.uniform(0.55, 1.05) * reach + half[0] * 0.5) * out + [0.0, 0.0, away]
    pose = Pose.from_rotvec([0.0, 0.0, turn + rng.normal(0.0, 0.3)], centre)
    return [("bar", box_solid(half).at(pose), skin)]


def behind(kind: str, rng: np.random.Generator, back_m: Array, folder: Path) -> Emitters:
    """What is behind the plate, whose back is at a point; in the left camera's frame."""
    made: Emitters = {}

    def wall(
        name: str, z_m: float, level: float, low_x_m: float = -4.0, high_x_m: float = 4.0, glow: float = 0.0
    ) -> None:
        area = Polygon([(low_x_m, -4.0), (high_x_m, -4.0), (high_x_m, 4.0), (low_x_m, 4.0)])
        path = folder / f"{name}.ply"
        flat(area, z_m).write(path)
        made[name] = {"type": "ply", "filename": str(path), "bsdf": matt(level)}
        if glow:
            made[name]["emitter"] = {"type": "area", "radiance": grey(glow)}

    def lamp(z_m: float, level: float) -> None:
        side = float(rng.choice([-1.0, 1.0]))
        at = np.array([side * (z_m + 0.25), rng.uniform(-0.3, 0.1), z_m - 0.12])
        target = np.array([back_m[0], back_m[1], z_m])
        made["wall_lamp"] = panel(at, target, (0.1, 0.1), np.array([0.0, 0.0, -1.0]), level)

    if kind == "dark":
        wall("wall", back_m[2] + rng.uniform(0.3, 1.0), rng.uniform(0.02, 0.08))
    elif kind == "bright":
        z_m = back_m[2] + rng.uniform(0.04, 0.4)
        if rng.random() < 0.4:
            wall("wall", z_m, 0.5, glow=rng.uniform(0.4, 1.5))
        else:
            wall("wall", z_m, rng.uniform(0.6, 0.9))
            lamp(z_m, rng.uniform(0.5, 2.0))
    elif kind == "half":
        # a border right behind the hole: one half bright, one half dark
        z_m = back_m[2] + rng.uniform(0.03, 0.3)
        seen_x = (back_m[0] - 0.025) / back_m[2] * z_m + 0.025 + rng.uniform(-0.012, 0.012)
        left_bright = rng.random() < 0.5
        wall("wall", z_m + 0.3, rng.uniform(0.02, 0.08))
        low, high = (-4.0, seen_x) if left_bright else (seen_x, 4.0)
        wall("half", z_m, 0.7, low, high, glow=rng.uniform(0.3, 1.2))
    else:
        wall("wall", back_m[2] + rng.uniform(0.4, 0.9), rng.uniform(0.03, 0.5))
        for index in range(int(rng.integers(8, 20))):
            half = rng.uniform(0.01, 0.07, 3)
            z_m = back_m[2] + rng.uniform(0.12, 0.5)
            at = np.array([rng.uniform(-0.8, 0.8) * z_m, rng.uniform(-0.65, 0.65) * z_m, z_m])
            if index < 3:
                at[:2] = back_m[:2] * z_m / back_m[2] + rng.uniform(-0.05, 0.05, 2)
            solid = box_solid(half) if rng.random() < 0.7 else prism(disc(half[0], 24), -half[2], half[2])
            path = folder / f"thing{index}.ply"
            solid.at(Pose.from_rotvec(rng.normal(0.0, 0.6, 3), at)).write(path)
            skin = matt(rng.uniform(0.03, 0.9)) if rng.random() < 0.6 else metal(0.6, (0.2, 0.2), 0.3)
            made[f"thing{index}"] = {"type": "ply", "filename": str(path), "bsdf": skin}
    return made
