"""`python -m tests.inference.push_agreement`: the mechanics' pushes against PyBullet's own contacts.

Random pushes of a free peg on a virtual wrist, of four kinds (wide: pose errors up to 0.08 rad and 3 mm; near: 0.02 rad
and 0.5 mm; bore: inside the hole, pushed any way; face: beside the hole), with and without friction, stiff and soft
wrist. The engine's motor side creeps at the end, so that its dampers carry next to nothing. Both are compared where
the motor side stands: force, moment, where the peg came to be, which contacts press.

Every push has its own seed. With --out the pushes are kept as they come, and a second run goes on where the first one
ended.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossPeg, Hole, Peg
from crosspih_common.shapes.named import NAMED, Sizes, tapered, tip_scale_of
from services.inference.mechanics import PairTables, SurfacePair, first_contact, first_contacts, push
from tests.inference.free_peg_world import COLLISION_MARGIN_M, STEP_S, FreePegWorld

KINDS = ("wide", "near", "bore", "face")
FRICTIONS = (0.0, 0.1)
WRISTS = {"stiff": (1e5, 1e3), "soft": (2e4, 2e2)}
SHAPES = ("cross", "cross", "cross", "square", "hexagon", "triangle", "star")
START_M = 5e-5
# Speeds of the motor side (m/s) up to the last of these distances (m) before the end.
SCHEDULE = ((2e-3, 2e-5), (2e-4, 3e-6), (2e-5, 0.0))
AVERAGED = 25


@dataclass(frozen=True)
class Agreement:
    """One push. force_n, moment_nm: the engine's. direction_deg: between the forces; moment_off_nm, force_off_n:
    between the vectors; place_off_m, turn_off_rad: between the peg's poses. The same with `own`: the engine's friction
    turned so that it opposes the engine's own slip. engine_contacts, model_contacts: how many press. friction_off_deg:
    the largest angle between friction and what opposes the slip, in the engine."""

    seed: int
    kind: str
    shape: str
    friction: float
    wrist: str
    force_n: float
    moment_nm: float
    direction_deg: float
    force_off_n: float
    moment_off_nm: float
    place_off_m: float
    turn_off_rad: float
    own_direction_deg: float
    own_moment_off_nm: float
    engine_contacts: int
    model_contacts: int
    friction_off_deg: float
    residual_n: float


@dataclass(frozen=True)
class Shape:
    """A peg, its hole, and their tables."""

    peg: Peg | CrossPeg
    hole: Hole
    tables: PairTables
    surfaces: SurfacePair
    rounded: SurfacePair


@cache
def shape_of(name: str) -> Shape:
    """The cross, or a named outline with a comparable taper; clearance 0.1 mm, chamfer 1 mm."""
    peg: Peg | CrossPeg
    if name == "cross":
        peg = CrossPeg()
    else:
        outline = NAMED[name](Sizes())
        peg = tapered(outline, 0.012, 0.0537, 0.0797, tip_scale_of(outline, 0.25, 0.026))
    hole = peg.hole(1e-4, 1e-3)
    tables = PairTables.of(peg, hole)
    rounded = SurfacePair.of(tables, edge_radius_m=COLLISION_MARGIN_M)
    return Shape(peg, hole, tables, SurfacePair.of(tables), rounded)


@dataclass(frozen=True)
class Case:
    """What is pushed, how, from where: start pose in the hole frame and free of it, direction, travel past contact."""

    seed: int
    kind: str
    shape: str
    friction: float
    wrist: str
    start: Pose
    direction: Array
    past_m: float


def draw_case(seed: int) -> Case:
    """The push of a seed; kinds, frictions and wrists take turns."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % 4]
    friction, wrist = FRICTIONS[seed // 4 % 2], list(WRISTS)[seed // 8 % 2]
    name = SHAPES[int(rng.integers(len(SHAPES)))]
    shape = shape_of(name)
    tip = shape.peg.tip_m
    while True:
        if kind == "bore":
            rotation = Pose.from_rotvec(rng.uniform(-0.003, 0.003, 3), np.zeros(3)).rotation
            depth = rng.uniform(0.002, 0.02) + shape.peg.taper_length_m
            at = np.array([*rng.uniform(-1e-4, 1e-4, 2), depth])
            direction = np.array([*rng.normal(size=2), rng.uniform(-0.3, 0.3)])
        else:
            turn, aside = {"wide": (0.08, 0.003), "near": (0.02, 0.0005), "face": (0.08, 0.003)}[kind]
            rotation = rotation_from_error_angles(rng.uniform(-turn, turn, 3)).T
            at = np.array([*rng.uniform(-aside, aside, 2), -0.004])
            if kind == "face":
                heading = rng.uniform(0.0, 2.0 * np.pi)
                at[:2] += 0.012 * np.array([np.cos(heading), np.sin(heading)])
            direction = np.array([*rng.uniform(-0.1, 0.1, 2), 1.0])
        direction = direction / np.linalg.norm(direction)
        start = Pose(rotation, at - rotation @ np.array([0.0, 0.0, tip]))
        arguments = (shape.tables, start.rotation[None], start.translation_m[None], direction[None])
        apart = first_contacts(*arguments).separation_m.min()
        travel = float(first_contact(*arguments).travel_m[0])
        if apart > 1e-6 and np.isfinite(travel):
            break
    past_m = rng.uniform(5.0, 20.0) / WRISTS[wrist][0]
    # From just before contact, so that neither side spends its time in the air.
    start = Pose(start.rotation, start.translation_m + max(travel - START_M, 0.0) * direction)
    return Case(seed, kind, name, friction, wrist, start, direction, past_m + min(travel, START_M))


@cache
def world_of(name: str, friction: float, wrist: str) -> FreePegWorld:
    """One world for all pushes that share it: every one of them starts from rest."""
    shape = shape_of(name)
    return FreePegWorld(shape.peg, shape.hole, friction, *WRISTS[wrist])


def compare(case: Case) -> Agreement:
    """Do one push in the engine and in the mechanics."""
    world, shape = world_of(case.shape, case.friction, case.wrist), shape_of(case.shape)
    world.place(case.start)
    wrenches: list[Array] = []
    positions: list[Array] = []
    travelled = 0.0
    for speed, before_end in SCHEDULE:
        while travelled < case.past_m - before_end - 1e-12:
            travelled = min(travelled + speed * STEP_S, case.past_m - before_end)
            command = Pose(case.start.rotation, case.start.translation_m + travelled * case.direction)
            world.step(command, np.concatenate([speed * case.direction, np.zeros(3)]))
            wrenches.append(world.contact_wrench_peg())
            positions.append(world.pose_hole_peg().translation_m)
            del wrenches[:-AVERAGED], positions[:-AVERAGED]
    pose, contacts = world.pose_hole_peg(), world.contacts()
    felt = np.mean(wrenches, axis=0)

    contact = float(
        first_contact(
            shape.tables, case.start.rotation[None], case.start.translation_m[None], case.direction[None]
        ).travel_m[0]
    )
    model = push(
        shape.tables, shape.surfaces, case.start.rotation[None], case.start.translation_m[None],
        case.direction[None], travelled - contact, world.compliance_peg, case.friction,
    )  # fmt: skip
    wrench = model.wrench_peg[0]

    own = np.zeros(6)
    friction_off = 0.0
    for one in contacts:
        slip = one.velocity_m_s - one.normal * (one.normal @ one.velocity_m_s)
        speed, size = float(np.linalg.norm(slip)), float(np.linalg.norm(one.friction_n))
        force = one.normal_n * one.normal + one.friction_n
        # Only where it slides; a point that sticks has no direction to oppose.
        if case.friction > 0.0 and size > 0.98 * case.friction * one.normal_n and speed > 1e-8:
            friction_off = max(friction_off, _between_deg(one.friction_n, -slip))
            force = one.normal_n * one.normal - size * slip / speed
        lever = one.point_m - pose.translation_m
        own += np.concatenate([pose.rotation.T @ force, pose.rotation.T @ np.cross(lever, force)])
    turned = Pose(model.rotation[0], model.translation_m[0])
    return Agreement(
        case.seed, case.kind, case.shape, case.friction, case.wrist,
        float(np.linalg.norm(felt[:3])), float(np.linalg.norm(felt[3:])),
        _between_deg(felt[:3], wrench[:3]), float(np.linalg.norm(felt[:3] - wrench[:3])),
        float(np.linalg.norm(felt[3:] - wrench[3:])),
        float(np.linalg.norm(pose.translation_m - turned.translation_m)), pose.angle_to_rad(turned),
        _between_deg(own[:3], wrench[:3]), float(np.linalg.norm(own[3:] - wrench[3:])),
        len(contacts), int(model.pressing[0].sum()), friction_off, float(model.residual_n[0]),
    )  # fmt: skip


def _between_deg(one: Array, other: Array) -> float:
    """The angle between two vectors, degrees; exact also where it is small."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))


def agreements(seeds: Iterable[int], out: Path | None = None) -> list[Agreement]:
    """All pushes of some seeds; those that a file (one JSON object a line) has already are taken from there."""
    kept = [Agreement(**json.loads(line)) for line in out.read_text().splitlines()] if out and out.exists() else []
    known = {one.seed: one for one in kept}
    found = []
    for seed in seeds:
        if seed not in known:
            known[seed] = compare(draw_case(seed))
            if out:
                with out.open("a") as file:
                    file.write(json.dumps(dataclasses.asdict(known[seed])) + "\n")
        found.append(known[seed])
    return found


QUANTILES = (0.5, 0.9, 0.99)
COLUMNS: tuple[tuple[str, Callable[[Agreement], float]], ...] = (
    ("force, deg", lambda one: one.direction_deg),
    ("force, N", lambda one: one.force_off_n),
    ("moment, mNm", lambda one: one.moment_off_nm * 1e3),
    ("peg, um", lambda one: one.place_off_m * 1e6),
    ("peg, urad", lambda one: one.turn_off_rad * 1e6),
    ("own friction: deg", lambda one: one.own_direction_deg),
    ("mNm", lambda one: one.own_moment_off_nm * 1e3),
)


def table_of(found: list[Agreement]) -> Table:
    """p50 / p90 / p99 of the differences, by kind, friction, wrist and number of contacts."""
    table = Table(title=f"{len(found)} pushes: mechanics against PyBullet, p50 / p90 / p99")
    for name in ("", "n", *(name for name, _ in COLUMNS)):
        table.add_column(name, justify="left" if name == "" else "right")
    groups: list[tuple[str, Callable[[Agreement], bool]]] = [("all", lambda one: True)]
    groups += [(kind, lambda one, k=kind: one.kind == k) for kind in KINDS]  # type: ignore[misc]
    groups += [(f"friction {mu}", lambda one, m=mu: one.friction == m) for mu in FRICTIONS]  # type: ignore[misc]
    groups += [(f"{wrist} wrist", lambda one, w=wrist: one.wrist == w) for wrist in WRISTS]  # type: ignore[misc]
    groups += [(name, lambda one, s=name: one.shape == s) for name in dict.fromkeys(SHAPES)]  # type: ignore[misc]
    groups += [
        ("one contact", lambda one: one.model_contacts == 1),
        ("two contacts", lambda one: one.model_contacts == 2),
        ("more contacts", lambda one: one.model_contacts > 2),
    ]
    for name, member in groups:
        rows = [one for one in found if member(one)]
        if rows:
            cells = [
                " / ".join(f"{value:.3g}" for value in np.quantile([of(one) for one in rows], QUANTILES))
                for _, of in COLUMNS
            ]
            table.add_row(name, str(len(rows)), *cells)
    return table


def main() -> None:
    """Run, print the table, or the single pushes as JSON."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--pushes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="file that keeps the pushes, one JSON object a line")
    parser.add_argument("--json", action="store_true", help="print the single pushes")
    arguments = parser.parse_args()
    console = Console()
    seeds = range(arguments.seed, arguments.seed + arguments.pushes)
    shown = seeds if arguments.json else track(seeds, description="pushes", console=console)
    found = agreements(shown, arguments.out)
    if arguments.json:
        print(json.dumps([dataclasses.asdict(one) for one in found]))
    else:
        console.print(table_of(found))


if __name__ == "__main__":
    main()
