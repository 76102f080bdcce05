"""A scene drawn by its seed: the plate with its hole (or with none), its surface and light, and what is round it.

All lengths in metres, in the left camera's frame: z ahead, x right, y down. The hole's pose is drawn in the cell's
prior as the default cell draws it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, box

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.bench.pictures.camera.cameras import Pair
from services.operator.bench.pictures.scenes import surroundings, targets
from services.operator.bench.pictures.scenes.finishes import FINISHES, FloatTexture, blotches, with_marks
from services.operator.bench.pictures.scenes.lights import Emitters, make_lights
from services.operator.bench.pictures.scenes.materials import Surface, cut_metal, machined, matt, metal, plastic
from services.operator.bench.pictures.tracing.solids import Solid, SolidRim, flat

HOLE = "hole"
SURFACES = ("matt", "painted", "plastic", *FINISHES, "anodised", "black", "paper")


@dataclass(frozen=True, slots=True)
class SceneSpec:
    """What to draw; what is left empty the seed draws.

    `target`: hole, or what is there instead (see `targets.MADE`). `through`: whether the background shows through.
    `cover`: bar, cable or peg, over up to a third of the rim. `walls`: lit or dark.
    """

    surface: str = "matt"
    light: str = "soft"
    background: str = "dark"
    target: str = HOLE
    outline: str = "cross"
    through: bool | None = None
    clutter: bool = False
    cover: str | None = None
    walls: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MadeScene:
    """A scene as it was made: parts for the renderer, and what is known of it."""

    parts: Emitters
    pose_camera_hole: Pose
    rim_m: Array
    plate_m: Array
    face_m: Array
    truth: dict[str, Any] = field(default_factory=dict)


def drawn_pose(workcell: Workcell, seed: int) -> Pose:
    """`pose_base_hole` of a seed, as the simulated cell draws it."""
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[0])
    prior = workcell.hole_prior
    offset = rng.uniform(-prior.half_ranges(), prior.half_ranges())
    return prior.pose_base_hole() @ Pose.from_rotvec(offset[3:], offset[:3])


def face_surface(kind: str, rng: np.random.Generator, factor: FloatTexture | None) -> Surface:
    """The plate's face."""
    if kind in FINISHES:
        return machined(kind, rng, factor)
    if kind == "matt":
        return matt(rng.uniform(0.45, 0.85), factor)
    if kind == "paper":
        return matt(rng.uniform(0.7, 0.9), factor)
    if kind == "painted":
        return plastic(rng.uniform(0.3, 0.8), rng.uniform(0.15, 0.4), factor)
    if kind == "plastic":
        return plastic(rng.uniform(0.3, 0.8), rng.uniform(0.08, 0.2), factor)
    if kind == "anodised":
        return metal(rng.uniform(0.05, 0.12), (rng.uniform(0.25, 0.4),) * 2, rng.uniform(0.3, 0.6), factor)
    return plastic(rng.uniform(0.03, 0.07), rng.uniform(0.15, 0.35), factor)


def rim_surfaces(kind: str, walls: str | None, rng: np.random.Generator) -> tuple[Surface, Surface]:
    """(the chamfer's, the bore's), for a face of that kind."""
    lit = rng.random() < 0.5 if walls is None else walls == "lit"
    if kind in FINISHES:
        return cut_metal(rng, rng.uniform(0.3, 0.8)), cut_metal(rng, rng.uniform(0.45, 0.8) if lit else 0.15)
    if kind in ("anodised", "black"):
        # the chamfer is cut after or before the colour: bare or black
        bare = rng.random() < 0.4
        rim = cut_metal(rng, rng.uniform(0.3, 0.6)) if bare else matt(rng.uniform(0.03, 0.06))
        return rim, matt(rng.uniform(0.03, 0.1) if not lit else rng.uniform(0.2, 0.4))
    level = rng.uniform(0.3, 0.8)
    return matt(level), matt(level * rng.uniform(0.6, 1.0) if lit else rng.uniform(0.04, 0.15))


def made_rim(workcell: Workcell, outline: str, surface: str, rng: np.random.Generator) -> SolidRim:
    """The rim as it was made: edges broken by .05 to .3 mm, size and chamfer within the drawing's tolerance."""
    hole = targets.hole_of(workcell, outline)
    broken = np.exp(rng.uniform(np.log(0.05e-3), np.log(0.3e-3)))
    if surface not in FINISHES:
        broken = rng.uniform(0.05e-3, 0.15e-3)
    size = float(np.clip(rng.normal(0.0, 0.01e-3), -0.025e-3, 0.025e-3))
    chamfer = hole.chamfer_m + float(np.clip(rng.normal(0.0, 0.04e-3), -0.1e-3, 0.1e-3))
    return SolidRim(hole.outline.grown(size), chamfer, float(broken))


def make(spec: SceneSpec, workcell: Workcell, pair: Pair, seed: int, folder: Path) -> MadeScene:
    """The scene of a seed; its meshes are written into a folder. The truth is that of the drawing's hole."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 20]))
    pose_base_hole = drawn_pose(workcell, seed)
    pose = pair.pose_base_camera.inverse() @ pose_base_hole
    normal = pose.rotate(np.array([0.0, 0.0, -1.0]))
    rim = made_rim(workcell, spec.outline, spec.surface, rng)
    drawn = targets.hole_of(workcell, spec.outline)
    through = rng.random() < 0.5 if spec.through is None else spec.through
    depth = float(rng.uniform(0.012, 0.05) if through else rng.uniform(0.018, 0.05))
    thickness = depth if through else depth + 0.008

    factor = None
    if spec.surface in ("matt", "painted", "plastic", "anodised", "black", "paper"):
        factor = blotches(rng, rng.uniform(0.005, 0.04), rng.uniform(0.0, 0.02))
    if spec.clutter:
        blank = np.ones((1024, 1024), dtype=np.float32)
        factor = with_marks(blank if factor is None else factor, rng, drawn.opening().reach_m)
    face = face_surface(spec.surface, rng, factor)
    rim_surface, wall_surface = rim_surfaces(spec.surface, spec.walls, rng)

    solids: list[tuple[str, Solid, Surface]] = []
    half = rng.uniform(max(0.05, 1.35 * drawn.opening().reach_m), 0.078, 2)
    shift = rng.uniform(-0.006, 0.006, 2)
    plate = box(*(shift - half), *(shift + half))
    area = plate
    holes_through: list[Polygon] = []
    if spec.clutter:
        extra, cut = surroundings.on_the_face(rng, plate, drawn.opening().radius_m)
        solids += extra
        area = area - cut
        holes_through.append(cut)
    what = targets.put(spec.target, rim, area, depth, thickness, (rim_surface, wall_surface, face), through, rng)
    solids += [("face", flat(what.face, 0.0), face), *what.solids]
    back = Polygon(plate.exterior)
    for cut in what.through:
        back = back - cut
    solids.append(("back", flat(back, thickness, 1.0), matt(0.3)))
    solids.append(("edge", targets.sides_of(plate, thickness), face_surface(spec.surface, rng, None)))
    if spec.cover is not None:
        solids += surroundings.in_front(spec.cover, rng, drawn.opening().corners_m, workcell)

    parts: Emitters = {}
    for index, (name, solid, surface) in enumerate(solids):
        path = folder / f"{index}_{name}.ply"
        solid.at(pose).write(path)
        parts[f"s{index}_{name}"] = {"type": "ply", "filename": str(path), "bsdf": surface}
    parts |= make_lights(spec.light, pose.translation_m, normal, folder, rng)
    parts |= surroundings.behind(spec.background, rng, pose.apply([0.0, 0.0, thickness]), folder)
    corners = np.array(plate.exterior.coords[:-1])
    opening = drawn.opening().corners_m
    about = np.concatenate([opening * (1.0 + 0.004 / np.hypot(*opening.T))[:, None],
                            opening * (1.0 + 0.009 / np.hypot(*opening.T))[:, None]])  # fmt: skip
    return MadeScene(
        parts,
        pose,
        pose.apply(_along(drawn.outer_rim_m(), 8)),
        pose.apply(np.column_stack([corners, np.zeros(4)])),
        pose.apply(np.column_stack([about, np.zeros(len(about))])),
        {
            "is_the_hole": spec.target == HOLE,
            "pose_base_hole": pose_base_hole.matrix().tolist(),
            "outline": spec.outline, "surface": spec.surface, "light": spec.light, "background": spec.background,
            "target": spec.target, "through": bool(through and spec.target == HOLE), "clutter": spec.clutter,
            "cover": spec.cover, "depth_mm": round(depth * 1e3, 2), "edge_break_mm": round(rim.edge_break_m * 1e3, 3),
            "chamfer_off_mm": round((rim.chamfer_m - drawn.chamfer_m) * 1e3, 3),
            "size_off_mm": round(float(rim.bore.offsets_m[0] - drawn.outline.offsets_m[0]) * 1e3, 4), "seed": seed,
        },
    )  # fmt: skip


def covered(made: MadeScene, hidden: list[NDArray[np.bool_]]) -> MadeScene:
    """With the share of the rim that is hidden from the left and from the right camera."""
    return replace(made, truth=made.truth | {"covered": [round(float(np.mean(one)), 3) for one in hidden]})


def _along(corners_m: Array, steps: int) -> Array:
    ends = np.roll(corners_m, -1, axis=0)
    shares = (np.arange(steps) / steps)[:, None, None]
    return np.asarray((corners_m + shares * (ends - corners_m)).reshape(-1, 3))
