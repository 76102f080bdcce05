"""`python -m tests.inference.push_agreement`: the mechanics' pushes against PyBullet's own contacts.

Random pushes of a free peg on a virtual wrist, of four kinds (wide: pose errors up to 0.08 rad and 3 mm; near: 0.02 rad
and 0.5 mm; bore: inside the hole, pushed any way; face: beside the hole), with and without friction, stiff and soft
wrist, several shapes. The engine's motor side creeps at the end, so that its dampers carry next to nothing. Both are
compared where the motor side stands: force, moment, where the peg came to be, how many contacts press.

Two comparisons tell where differences come from. The engine snaps the corners of convex hulls to a grid of some
micrometres: the mechanics are also given the hulls that the engine really holds. And its friction does not quite oppose
its own slip: that force is also compared after it was turned to do so.

Every push has its own seed. With --out the engine's pushes are kept as they come, and a second run goes on where the
first one ended.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.provenance import ResultStore, code_version, result_key
from crosspih_common.shapes import CrossPeg, Hole, Peg
from crosspih_common.shapes.named import NAMED, Sizes, tapered, tip_scale_of
from services.inference.mechanics import PairTables, PushedPegs, SurfacePair, first_contact, first_contacts, push
from services.inference.mechanics.polyhedron import Polyhedron
from tests.inference.free_peg_world import COLLISION_MARGIN_M, STEP_S, FreePegWorld

KINDS = ("wide", "near", "bore", "face")
FRICTIONS = (0.0, 0.1)
WRISTS = {"stiff": (1e5, 1e3), "soft": (2e4, 2e2)}
SHAPES = ("cross", "cross", "cross", "square", "hexagon", "triangle", "star")
START_M = 5e-5
# Speeds of the motor side (m/s) up to the last of these distances (m) before the end.
SCHEDULE = ((2e-3, 2e-5), (2e-4, 3e-6), (2e-5, 0.0))
AVERAGED = 25
SLIDES_M_S = 3e-6


@dataclass(frozen=True)
class Shape:
    """A peg, its hole, and their tables: as drawn, and as the engine holds them."""

    peg: Peg | CrossPeg
    hole: Hole
    drawn: tuple[PairTables, SurfacePair]


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
    return Shape(peg, hole, (tables, SurfacePair.of(tables)))


@cache
def world_of(name: str, friction: float, wrist: str) -> FreePegWorld:
    """One world for all pushes that share it: every one of them starts from rest."""
    shape = shape_of(name)
    return FreePegWorld(shape.peg, shape.hole, friction, *WRISTS[wrist])


@cache
def snapped(name: str) -> tuple[PairTables, SurfacePair]:
    """The tables of the hulls that the engine holds, with its margin as their skin."""
    peg, hole = world_of(name, 0.0, "stiff").hulls()
    side = shape_of(name).hole.plate_half_size_m - COLLISION_MARGIN_M
    tables = PairTables.of_polyhedra(
        tuple(Polyhedron.hull(corners) for corners in peg), tuple(Polyhedron.hull(corners) for corners in hole), side
    )
    return tables, SurfacePair.of(tables, skin_m=COLLISION_MARGIN_M)


# what draws and pushes, beside the mechanics
MADE_BY = ("tests.inference.push_agreement", "tests.inference.free_peg_world")


@dataclass(frozen=True)
class Case:
    """What is pushed, how, from where: start pose in the hole frame and free of it, direction, travel to the end."""

    seed: int
    kind: str
    shape: str
    friction: float
    wrist: str
    start: Pose
    direction: Array
    travel_m: float


def draw_case(seed: int) -> Case:
    """The push of a seed; kinds, frictions and wrists take turns."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % 4]
    friction, wrist = FRICTIONS[seed // 4 % 2], list(WRISTS)[seed // 8 % 2]
    name = SHAPES[int(rng.integers(len(SHAPES)))]
    shape = shape_of(name)
    while True:
        if kind == "bore":
            rotation = Pose.from_rotvec(rng.uniform(-0.003, 0.003, 3), np.zeros(3)).rotation
            at = np.array([*rng.uniform(-1e-4, 1e-4, 2), rng.uniform(0.002, 0.02) + shape.peg.taper_length_m])
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
        start = Pose(rotation, at - rotation @ np.array([0.0, 0.0, shape.peg.tip_m]))
        pairs = first_contacts(shape.drawn[0], start.rotation[None], start.translation_m[None], direction[None])
        travel = float(pairs.travel_m.min())
        if pairs.separation_m.min() > 1e-6 and np.isfinite(travel):
            break
    past_m = rng.uniform(5.0, 20.0) / WRISTS[wrist][0]
    # From just before contact, so that neither side spends its time in the air.
    start = Pose(start.rotation, start.translation_m + max(travel - START_M, 0.0) * direction)
    return Case(seed, kind, name, friction, wrist, start, direction, past_m + min(travel, START_M))


def engine_push(case: Case) -> dict[str, Any]:
    """What the engine says: wrench averaged over the last steps and its spread, pose, contacts at the end."""
    world = world_of(case.shape, case.friction, case.wrist)
    world.place(case.start)
    wrenches: list[Array] = []
    travelled = 0.0
    for speed, before_end in SCHEDULE:
        while travelled < case.travel_m - before_end - 1e-12:
            travelled = min(travelled + speed * STEP_S, case.travel_m - before_end)
            command = Pose(case.start.rotation, case.start.translation_m + travelled * case.direction)
            world.step(command, np.concatenate([speed * case.direction, np.zeros(3)]))
            wrenches.append(world.contact_wrench_peg())
            del wrenches[:-AVERAGED]
    pose = world.pose_hole_peg()
    return {
        "seed": case.seed,
        "wrench": np.mean(wrenches, axis=0).tolist(),
        "unsteady_n": float(np.linalg.norm(np.std(wrenches, axis=0)[:3])),
        "rotation": pose.rotation.tolist(),
        "translation_m": pose.translation_m.tolist(),
        "contacts": [
            {
                "point_m": one.point_m.tolist(),
                "normal": one.normal.tolist(),
                "normal_n": one.normal_n,
                "friction_n": one.friction_n.tolist(),
                "velocity_m_s": one.velocity_m_s.tolist(),
            }
            for one in world.contacts()
        ],
    }


@dataclass(frozen=True)
class Difference:
    """Engine against one set of the mechanics' tables: angle between forces, force, moment, place and turn of the peg;
    how many contacts press in the mechanics."""

    direction_deg: float
    force_n: float
    moment_nm: float
    place_m: float
    turn_rad: float
    contacts: int


@dataclass(frozen=True)
class Agreement:
    """One push. force_n, moment_nm: the engine's; unsteady_n: how much its force still changed. drawn, snapped: against
    the drawing, and against the hulls that the engine holds; turned: the latter with friction turned against the slip.
    friction_off_deg: the largest angle between the engine's friction and what opposes its slip."""

    case: Case
    force_n: float
    moment_nm: float
    unsteady_n: float
    contacts: int
    drawn: Difference
    snapped: Difference
    turned: Difference
    friction_off_deg: float


def _turned_wrench(case: Case, record: dict[str, Any]) -> tuple[Array, float]:
    """The engine's wrench (6,) with the friction of every sliding contact turned against its slip; largest turn."""
    rotation, origin = np.array(record["rotation"]), np.array(record["translation_m"])
    wrench, largest = np.array(record["wrench"]), 0.0
    for one in record["contacts"]:
        normal, velocity = np.array(one["normal"]), np.array(one["velocity_m_s"])
        friction, point = np.array(one["friction_n"]), np.array(one["point_m"])
        slip = velocity - normal * (normal @ velocity)
        speed, size = float(np.linalg.norm(slip)), float(np.linalg.norm(friction))
        # Only where it slides: a point that sticks, or all but does, has no direction to oppose.
        if case.friction > 0.0 and size > 0.98 * case.friction * one["normal_n"] and speed > SLIDES_M_S:
            largest = max(largest, _between_deg(friction, -slip))
            change = -size * slip / speed - friction
            wrench += np.concatenate([rotation.T @ change, rotation.T @ np.cross(point - origin, change)])
    return wrench, largest


def _between_deg(one: Array, other: Array) -> float:
    """The angle between two vectors, degrees; exact also where it is small."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))


def _pushes(cases: list[Case], tables: PairTables, surfaces: SurfacePair) -> PushedPegs:
    """The mechanics' pushes of cases of one shape, all to where the engine's motor side went."""
    rotation = np.array([case.start.rotation for case in cases])
    translation = np.array([case.start.translation_m for case in cases])
    direction = np.array([case.direction for case in cases])
    travel = first_contact(tables, rotation, translation, direction).travel_m
    past = np.array([case.travel_m for case in cases]) - travel
    compliance = np.array([world_of(case.shape, case.friction, case.wrist).compliance_peg for case in cases])
    friction = np.array([case.friction for case in cases])
    return push(tables, surfaces, rotation, translation, direction, past, compliance, friction)


def _difference(wrench: Array, record: dict[str, Any], model: PushedPegs, index: int) -> Difference:
    own = model.wrench_peg[index]
    pose = Pose(np.array(record["rotation"]), np.array(record["translation_m"]))
    found = Pose(model.rotation[index], model.translation_m[index])
    return Difference(
        _between_deg(wrench[:3], own[:3]),
        float(np.linalg.norm(wrench[:3] - own[:3])),
        float(np.linalg.norm(wrench[3:] - own[3:])),
        pose.distance_to_m(found),
        pose.angle_to_rad(found),
        int(model.pressing[index].sum()),
    )


def agreements(seeds: Iterable[int], out: Path | None = None) -> list[Agreement]:
    """All pushes of some seeds; those whose engine part a store has, made by this code, are taken from there."""
    known: dict[int, dict[str, Any]] = {}
    code = "" if out is None else code_version(*MADE_BY)
    store = None if out is None else ResultStore(out, "--out")
    cases = []
    for seed in seeds:
        cases.append(draw_case(seed))
        key = result_key({"push": seed, "code": code})
        kept = None if store is None else store.get(key)
        if kept is None:
            started = time.monotonic()
            kept = engine_push(cases[-1])
            if store is not None:
                store.put(key, kept, code=code, took_s=round(time.monotonic() - started, 3))
        known[seed] = kept
    if store is not None:
        print(store.reuse_summary(code), file=sys.stderr)
        store.close()
    found: dict[int, Agreement] = {}
    for name in dict.fromkeys(case.shape for case in cases):
        group = [case for case in cases if case.shape == name]
        drawn, engine = _pushes(group, *shape_of(name).drawn), _pushes(group, *snapped(name))
        for index, case in enumerate(group):
            record = known[case.seed]
            wrench = np.array(record["wrench"])
            turned, friction_off = _turned_wrench(case, record)
            found[case.seed] = Agreement(
                case,
                float(np.linalg.norm(wrench[:3])),
                float(np.linalg.norm(wrench[3:])),
                record["unsteady_n"],
                len(record["contacts"]),
                _difference(wrench, record, drawn, index),
                _difference(wrench, record, engine, index),
                _difference(turned, record, engine, index),
                friction_off,
            )
    return [found[case.seed] for case in cases]


QUANTILES = (0.5, 0.9, 0.99)
MEASURES: tuple[tuple[str, Callable[[Difference], float]], ...] = (
    ("force deg", lambda one: one.direction_deg),
    ("force N", lambda one: one.force_n),
    ("moment mNm", lambda one: one.moment_nm * 1e3),
    ("peg um", lambda one: one.place_m * 1e6),
    ("peg urad", lambda one: one.turn_rad * 1e6),
)


def tables_of(found: list[Agreement]) -> list[Table]:
    """p50 / p90 / p99 of the differences, by kind, friction, wrist, shape and number of contacts."""
    groups: list[tuple[str, list[Agreement]]] = [("all", found)]
    groups += [(kind, [one for one in found if one.case.kind == kind]) for kind in KINDS]
    groups += [(f"friction {mu}", [one for one in found if one.case.friction == mu]) for mu in FRICTIONS]
    groups += [(f"{wrist} wrist", [one for one in found if one.case.wrist == wrist]) for wrist in WRISTS]
    groups += [(name, [one for one in found if one.case.shape == name]) for name in dict.fromkeys(SHAPES)]
    groups += [
        ("1 contact", [one for one in found if one.snapped.contacts == 1]),
        ("2 contacts", [one for one in found if one.snapped.contacts == 2]),
        ("3 or more", [one for one in found if one.snapped.contacts > 2]),
    ]
    whats: tuple[tuple[str, Callable[[Agreement], Difference]], ...] = (
        ("as drawn", lambda one: one.drawn),
        ("with the hulls that the engine holds", lambda one: one.snapped),
        ("and its friction turned against its slip", lambda one: one.turned),
    )
    made = []
    for title, which in whats:
        table = Table(title=f"{len(found)} pushes, mechanics against PyBullet, p50 / p90 / p99: {title}")
        for name in ("", "n", *(name for name, _ in MEASURES)):
            table.add_column(name, justify="left" if name == "" else "right", no_wrap=True)
        for name, rows in groups:
            if rows:
                cells = [
                    " / ".join(f"{value:.2g}" for value in np.quantile([of(which(one)) for one in rows], QUANTILES))
                    for _, of in MEASURES
                ]
                table.add_row(name, str(len(rows)), *cells)
        made.append(table)
    return made


def main() -> None:
    """Run, print the tables, or the single pushes as JSON."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--pushes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="file that keeps the engine's pushes, one JSON object a line")
    parser.add_argument("--json", action="store_true", help="print the single pushes")
    arguments = parser.parse_args()
    console = Console(width=150)
    seeds = range(arguments.seed, arguments.seed + arguments.pushes)
    found = agreements(seeds if arguments.json else track(seeds, "pushes", console=console), arguments.out)
    if arguments.json:
        plain = []
        for one in found:
            case = one.case
            row = {name: getattr(case, name) for name in ("seed", "kind", "shape", "friction", "wrist")}
            parts = {name: value for name, value in dataclasses.asdict(one).items() if name != "case"}
            plain.append({**row, **parts})
        print(json.dumps(plain))
        return
    for table in tables_of(found):
        console.print(table)
    off = [one.friction_off_deg for one in found if one.friction_off_deg > 0.0]
    console.print(f"engine's friction off its own slip, deg, p50 / p90 / p99: {np.quantile(off, QUANTILES).round(2)}")
    same = np.mean([one.contacts == one.snapped.contacts for one in found])
    unsteady = sum(one.unsteady_n > 0.02 for one in found)
    console.print(f"same number of contacts: {same:.1%}; the engine's force unsteady (sd > 0.02 N): {unsteady}")


if __name__ == "__main__":
    main()
