"""Histories of touches made by the mechanics, for training the sequence network."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg
from services.inference.mechanics import PairTables
from services.inference.network.paper.synthesis import pushed_until_contact
from services.inference.network.sequence.touch_features import TouchHistory
from services.inference.touch_choice.by_rule import next_touch

TRIES = 4
CUT_SD = 2.5
STANDOFF_M = 0.004


@dataclass(frozen=True, slots=True)
class TouchWorld:
    """The distribution of the histories; ranges are (low, high), in m, rad, N.

    The prior's sds are log-uniform: lateral_sd_m, depth_sd_m, tilt_sd_rad, turn_sd_rad; the hole is Gaussian about it,
    cut at 2.5 sd. friction and force_n are uniform. policy_share of the histories follow the touch policy about a
    belief that approaches the truth, as in an assembly; the others start at random about it, up to shift_m and
    angle_rad off. Noise: force_sd_n and moment_sd_nm of a reading, place_sd_m and turn_error_sd_rad of the peg's pose.
    The
    wrist's compliance, along (m/N) and about (rad/Nm) each axis, is log-uniform within +-compliance_spread of its mean.
    """

    lateral_sd_m: tuple[float, float] = (1e-4, 6e-3)
    depth_sd_m: tuple[float, float] = (2e-4, 9e-3)
    tilt_sd_rad: tuple[float, float] = (4e-3, 6e-2)
    turn_sd_rad: tuple[float, float] = (1.5e-3, 6e-2)
    friction: tuple[float, float] = (0.0, 0.3)
    force_n: tuple[float, float] = (6.0, 20.0)
    travel_limit_m: float = 0.045
    policy_share: float = 0.7
    shift_m: float = 0.004
    angle_rad: float = 0.06
    force_sd_n: float = 0.02
    moment_sd_nm: float = 0.001
    place_sd_m: float = 2e-5
    turn_error_sd_rad: float = 1e-4
    compliance: tuple[float, float] = (1e-5, 1e-3)
    compliance_spread: float = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class SequenceDataset:
    """N histories of K touches, and the hole's true pose error (N, 6) about its prior (right perturbation)."""

    history: TouchHistory
    error: Array

    def __len__(self) -> int:
        return len(self.error)

    def rows(self, index: NDArray[np.int64] | slice) -> SequenceDataset:
        """Some of the histories."""
        h = self.history
        return SequenceDataset(
            TouchHistory(h.rotation[index], h.translation_m[index], h.wrench[index], h.direction[index],
                         h.prior_sd[index]),
            self.error[index],
        )  # fmt: skip

    def sha256(self) -> str:
        """A hash of all columns."""
        digest = hashlib.sha256()
        h = self.history
        for column in (h.rotation, h.translation_m, h.wrench, h.direction, h.prior_sd, self.error):
            digest.update(np.ascontiguousarray(column, dtype="<f8").tobytes())
        return digest.hexdigest()


def touch_sequences(
    peg: Peg,
    hole: Hole,
    count: int,
    touches: int,
    rng: np.random.Generator,
    world: TouchWorld | None = None,
    on_made: Callable[[int], None] = lambda made: None,
) -> SequenceDataset:
    """`count` histories of `touches` touches of one contact each.

    A push that meets nothing is repeated elsewhere, up to `TRIES` times; a history that still lacks a touch is drawn
    anew. `on_made` is called with the number of histories so far.
    """
    world = world or TouchWorld()
    tables = PairTables.of(peg, hole)
    parts: list[SequenceDataset] = []
    made = 0
    while made < count:
        part = _block(peg, tables, min(count - made + 32, 1024), touches, rng, world)
        part = part.rows(slice(0, count - made))
        parts.append(part)
        made += len(part)
        on_made(made)
    histories = [part.history for part in parts]
    return SequenceDataset(
        TouchHistory(
            np.concatenate([h.rotation for h in histories]),
            np.concatenate([h.translation_m for h in histories]),
            np.concatenate([h.wrench for h in histories]),
            np.concatenate([h.direction for h in histories]),
            np.concatenate([h.prior_sd for h in histories]),
        ),
        np.concatenate([part.error for part in parts]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Draw:
    """n holes and the settings of their touches: sd and error (n, 6); to_hole (n, 3, 3); friction (n,); compliance (n,
    6, 6); by_policy (n,): whether the touch policy plans the pushes; failed_before (n,): pushes that failed before."""

    sd: Array
    error: Array
    to_hole: Array
    friction: Array
    compliance: Array
    by_policy: NDArray[np.bool_]
    failed_before: NDArray[np.int64]

    @classmethod
    def of(cls, n: int, rng: np.random.Generator, world: TouchWorld) -> _Draw:
        ranges = (world.lateral_sd_m, world.depth_sd_m, world.tilt_sd_rad, world.turn_sd_rad)
        lateral, depth, tilt, turn = (np.exp(rng.uniform(np.log(low), np.log(high), n)) for low, high in ranges)
        sd = np.column_stack([lateral, lateral, depth, tilt, tilt, turn])
        error = np.clip(rng.normal(size=(n, 6)), -CUT_SD, CUT_SD) * sd
        friction = rng.uniform(*world.friction, n)
        by_policy = rng.random(n) < world.policy_share
        # one push failed before the first touch of an assembly, none when the planner only touches
        failed_before = rng.integers(0, 3, n)
        compliance = np.zeros((n, 6, 6))
        for axis, mean in enumerate(np.repeat(world.compliance, 3)):
            compliance[:, axis, axis] = mean * np.exp(rng.uniform(-1.0, 1.0, n) * world.compliance_spread)
        to_hole = np.swapaxes(Rotation.from_rotvec(error[:, 3:]).as_matrix(), 1, 2)
        return cls(sd, error, to_hole, friction, compliance, by_policy, failed_before)


def _block(
    peg: Peg, tables: PairTables, n: int, touches: int, rng: np.random.Generator, world: TouchWorld
) -> SequenceDataset:
    """Up to n histories. The base frame is the prior's hole frame {P}."""
    drawn = _Draw.of(n, rng, world)
    # the belief before the first touch is the prior itself
    off = -np.einsum("nij,nj->ni", drawn.to_hole, drawn.error[:, :3])
    belief_error, spread = np.column_stack([off, -drawn.error[:, 3:]]), np.ones((n, 6))
    columns: list[tuple[Array, Array, Array, Array]] = []
    whole = np.ones(n, bool)
    for made in range(touches):
        touch, missed = _touch(peg, tables, drawn, np.flatnonzero(whole), made, belief_error, spread, rng, world)
        columns.append(touch)
        whole[missed] = False
        # the belief after this touch is nearer to the truth by a share that differs from axis to axis
        spread = spread * rng.uniform(0.15, 1.0, (n, 6))
        belief_error = np.clip(rng.normal(size=(n, 6)), -CUT_SD, CUT_SD) * drawn.sd * spread
    rotation, translation, wrench, direction = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
    history = TouchHistory(rotation, translation, wrench, direction, drawn.sd)
    return SequenceDataset(history, drawn.error).rows(np.flatnonzero(whole))


def _touch(
    peg: Peg, tables: PairTables, drawn: _Draw, left: NDArray[np.int64], made: int, belief_error: Array,
    spread: Array, rng: np.random.Generator, world: TouchWorld,
) -> tuple[tuple[Array, Array, Array, Array], NDArray[np.int64]]:  # fmt: skip
    """One touch of each hole in `left`: rotation, translation, wrench and direction (n, ...) as measured, and the holes
    that were missed `TRIES` times."""
    n = len(drawn.error)
    rotation, translation = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    direction, wrench = np.tile([0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 6))
    for attempt in range(TRIES):
        by_policy = drawn.by_policy & (attempt == 0)
        turned, start, motion = _starts(peg, drawn, left, made, by_policy, belief_error, spread, rng, world)
        to_hole = drawn.to_hole[left]
        travel, felt = pushed_until_contact(
            tables,
            to_hole @ turned,
            np.einsum("nij,nj->ni", to_hole, start - drawn.error[left, :3]),
            np.einsum("nij,nj->ni", to_hole, motion),
            rng.uniform(*world.force_n, len(left)),
            drawn.friction[left],
            drawn.compliance[left],
        )
        met = (travel > 0.0) & (travel < world.travel_limit_m)
        rows = left[met]
        rotation[rows], direction[rows], wrench[rows] = turned[met], motion[met], felt[met]
        translation[rows] = start[met] + travel[met, None] * motion[met]
        left = left[~met]
        if len(left) == 0:
            break
    wrench += rng.normal(size=(n, 6)) * np.repeat([world.force_sd_n, world.moment_sd_nm], 3)
    translation += rng.normal(size=(n, 3)) * world.place_sd_m
    rotation = rotation @ Rotation.from_rotvec(rng.normal(size=(n, 3)) * world.turn_error_sd_rad).as_matrix()
    return (rotation, translation, wrench, direction), left


def _starts(
    peg: Peg, drawn: _Draw, rows: NDArray[np.int64], made: int, by_policy: NDArray[np.bool_], belief_error: Array,
    spread: Array, rng: np.random.Generator, world: TouchWorld,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Rotation (m, 3, 3), translation (m, 3) and direction (m, 3) in {P} from which pegs are pushed."""
    n = len(rows)
    rotation, translation, direction = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    shift, angles = rng.uniform(-1.0, 1.0, (n, 2)) * world.shift_m, rng.uniform(-1.0, 1.0, (n, 3)) * world.angle_rad
    for place, row in enumerate(rows):
        truth = Pose.from_rotvec(drawn.error[row, 3:], drawn.error[row, :3])
        belief = truth @ Pose.from_rotvec(belief_error[row, 3:], belief_error[row, :3])
        sd = drawn.sd[row] * spread[row]
        if by_policy[row]:
            plan = next_touch(peg, belief, np.diag(sd**2), int(drawn.failed_before[row]) + made, made)
            start, motion = plan.pose_base_peg_start, plan.direction_base
        else:
            off = Pose.from_rotvec(angles[place], [*shift[place], -STANDOFF_M - CUT_SD * sd[2]])
            start = belief @ off @ Pose.from_translation([0.0, 0.0, -peg.tip_m])
            motion = start.rotation[:, 2]
        rotation[place], translation[place], direction[place] = start.rotation, start.translation_m, motion
    return rotation, translation, direction
