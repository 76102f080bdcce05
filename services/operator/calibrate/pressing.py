"""Gentle pushes on the plate beside the hole, in many postures, and dwells in free air.

The rigid body is the plate of the cell's file (`cell.hole_prior`): the arm may touch there and nowhere else, and its
caps apply. Three touches in one orientation find the plate's normal. Each push then begins a few millimetres before the
plate, touches it, and is held at rest at increasing depths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from scipy.spatial.transform import Rotation

from crosspih_common.arm.inverse import InverseError, nearest
from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.calibration.presses import (
    APART_M,
    Press,
    Pressed,
    RestLevel,
    held,
    jacobian_at,
    touching_corner,
    wrench_base,
)
from crosspih_common.collision import CollisionModel
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.holding import hold_arm
from crosspih_common.keys import FT_CALIBRATION, SET_PAYLOAD
from crosspih_common.messages import GuardedMove, MotionOutcome, SetPayload, StopReason, floats
from services.operator.assembly.session import Session
from services.operator.calibrate.folder import now
from services.operator.calibrate.moving import HeldArm
from services.operator.cli.time_left import TimeLeft

TILTS_RAD = (0.2, 0.42)
BESIDE_M = 0.014  # from the rim of the hole to the corner that touches
AWAY_M, BEFORE_M, DEEP_M = 0.022, 0.003, 0.008
TOUCH_N, TOUCH_M_S, CREEP_M_S, PROBE_M_S = 2.0, 0.004, 0.0003, 0.01
MAX_LANDED, LANDED, SLOWEST_M_S = 0.5, 0.2, 3e-4  # share of the force, once the touch is at rest
SHARES = (0.35, 0.68, 1.0)  # shares of the force, at the depths of a push
FREE_S, HELD_S, SETTLE_S = 0.5, 0.5, 0.15
WEIGHINGS, WRIST_RAD, WEIGHING_TRIES = 10, 1.3, 400
SPIN_RAD = 1.6
ORIENTATIONS, ROUND, MIN_AREA_M2 = 4, (0, 4, 8, 2, 6, 10, 1, 5, 9, 3, 7, 11), 4e-4


@dataclass(frozen=True, slots=True)
class PressingManner:
    """How many pushes, how hard at most, and the seed of the postures."""

    presses: int = 16
    force_n: float = 18.0
    seed: int = 0


def postures(workcell: Workcell, count: int, seed: int) -> list[tuple[Array, Array]]:
    """(rotation (3, 3) of the peg in the nominal hole's frame, place (2,) of the tip's corner on its face, m), more
    than are needed: tilted so that one corner of the tip touches, in all directions and all about the plate.
    """
    rng, peg = np.random.default_rng(seed), workcell.peg.shape()
    radius = workcell.hole.shape(peg).opening().reach_m + BESIDE_M
    found: list[tuple[Array, Array]] = []
    for number in range(40 * count):
        if len(found) >= 3 * count:
            break
        tilt, side = TILTS_RAD[number % len(TILTS_RAD)], rng.uniform(0.0, 2.0 * np.pi)
        lean = Rotation.from_rotvec(tilt * np.array([-np.sin(side), np.cos(side), 0.0]))
        spin = rng.uniform(-SPIN_RAD, SPIN_RAD)
        rotation = (lean * Rotation.from_rotvec([0.0, 0.0, spin])).as_matrix()
        if touching_corner(peg, rotation, np.array([0.0, 0.0, 1.0]))[1] < 2.0 * APART_M:
            continue
        at = 2.0 * np.pi * number / (1.3 * count)  # neighbours follow each other, at least once around
        found.append((rotation, radius * np.array([np.cos(at), np.sin(at)])))
    if len(found) < count:
        raise CalibrationRefused(
            "cell.peg: no tilt has one corner of this peg's tip touch alone; use a peg with corners, such as a cross"
        )
    return found


def _area(*poses: Pose) -> float:
    """Of the triangle between three poses' origins, m2."""
    first, second, third = (pose.translation_m for pose in poses)
    return 0.5 * float(np.linalg.norm(np.cross(second - first, third - first)))


class Presser:
    """Makes pushes with an arm that is held and has its payload set."""

    def __init__(self, arm: HeldArm, console: Console, manner: PressingManner) -> None:
        self._arm, self._console, self._manner = arm, console, manner
        self._workcell = workcell = arm.workcell
        self._collisions = CollisionModel(workcell)
        self._peg = workcell.peg.shape()
        self._nominal = workcell.hole_prior.pose_base_hole()
        self._back = workcell.pose_flange_peg().inverse()
        self.normal = self._nominal.rotation[:, 2]
        self._offset: float | None = None  # height of the plate along the normal, once it is known
        self._touch_m_s = TOUCH_M_S

    def _level(self, duration_s: float) -> tuple[RestLevel, MotionOutcome]:
        self._arm.dwell(SETTLE_S)
        outcome = self._arm.dwell(duration_s)
        level = RestLevel(joints_rad=outcome.joints_rad, raw=outcome.wrench_raw, raw_sd=outcome.wrench_sd)
        return level, outcome

    def _before(self, rotation: Array, place: Array, away_m: float) -> Pose:
        """The peg with its touching corner at this distance before the plate, over a place of the nominal face (2,)."""
        turned = self._nominal.rotation @ rotation
        corner, _ = touching_corner(self._peg, turned, self.normal)
        point = self._nominal.apply([*place, 0.0])
        if self._offset is not None:
            point = point + self.normal * (self._offset - float(self.normal @ point))
        return Pose(turned, point - self.normal * away_m - turned @ corner)

    def _front(self) -> Pose:
        """On the nominal hole's axis, clear of the plate wherever it may be."""
        far = self._workcell.hole_prior.half_range_depth_m + AWAY_M + self._peg.tip_m
        return self._collisions.before_zone(self._nominal @ Pose.from_translation([0.0, 0.0, -far]))

    def to_front(self) -> None:
        """From free space to the pose before the plate. Raises CalibrationRefused, CommandRefused, MoveEnded."""
        try:
            joints = nearest(self._workcell.arm(), self._front() @ self._back, self._arm.joints_rad)
        except InverseError as error:
            raise CalibrationRefused(f"the plate cannot be come to: {error}") from None
        self._arm.go([joints])

    def back_home(self, home: Array) -> None:
        """From the pose before the plate back to the start."""
        self._arm.slide(self._front())
        self._arm.go([home])

    def find_normal(self) -> None:
        """Three touches in one orientation, around the hole, wherever the arm can reach.

        Raises CalibrationRefused where nothing is touched, or no three places can be reached.
        """
        why = ""
        for rotation, first in postures(self._workcell, ORIENTATIONS, self._manner.seed)[::2]:
            touched: list[Pose] = []
            for turn in ROUND:
                spun = Rotation.from_rotvec([0.0, 0.0, 2.0 * np.pi * turn / len(ROUND)]).as_matrix()[:2, :2]
                try:
                    pose = self._touched(rotation, spun @ first)
                except CommandRefused as refusal:
                    why = str(refusal)
                    continue
                if len(touched) < 2 or _area(touched[0], touched[1], pose) > MIN_AREA_M2:
                    touched.append(pose)
                if len(touched) == 3:
                    self._plane_of(touched)
                    return
        raise CalibrationRefused(f"the plate cannot be touched at three places around the hole: {why}")

    def _touched(self, rotation: Array, place: Array) -> Pose:
        """The peg's pose at the touch; the peg is drawn back afterwards."""
        depth = self._workcell.hole_prior.half_range_depth_m
        self._arm.slide(self._before(rotation, place, depth + AWAY_M))
        outcome = self._arm.touch(
            GuardedMove(
                direction_base=floats(self.normal), speed_m_s=PROBE_M_S, creep_speed_m_s=CREEP_M_S,
                force_threshold_n=TOUCH_N, travel_limit_m=2.0 * depth + AWAY_M + DEEP_M, retreat_m=AWAY_M,
            )
        )  # fmt: skip
        if outcome.stop_reason is not StopReason.CONTACT or outcome.pose_base_peg_observed is None:
            raise CalibrationRefused(
                f"nothing was touched within {1e3 * (2.0 * depth + AWAY_M):.0f} mm: is the plate where cell.hole_prior "
                "has it?"
            )
        return outcome.pose_base_peg_observed.pose()

    def _plane_of(self, touched: list[Pose]) -> None:
        one, other = (touched[i].translation_m - touched[0].translation_m for i in (1, 2))
        normal = np.cross(one, other)
        normal /= np.linalg.norm(normal)
        self.normal = normal if normal @ self.normal > 0.0 else -normal
        corner, _ = touching_corner(self._peg, touched[0].rotation, self.normal)
        self._offset = float(np.mean([self.normal @ pose.apply(corner) for pose in touched]))

    def press(self, rotation: Array, place: Array) -> Press | None:
        """One push; None where the arm cannot get there."""
        try:
            self._arm.slide(self._before(rotation, place, AWAY_M))
            self._arm.slide(self._before(rotation, place, BEFORE_M))
        except CommandRefused as refusal:
            self._console.print(f"  left out: {refusal}", style="dim", highlight=False, markup=False, soft_wrap=True)
            return None
        free, _ = self._level(FREE_S)
        outcome = self._arm.touch(
            GuardedMove(
                direction_base=floats(self.normal), speed_m_s=self._touch_m_s,
                creep_speed_m_s=min(CREEP_M_S, self._touch_m_s / 3.0), force_threshold_n=TOUCH_N,
                travel_limit_m=BEFORE_M + DEEP_M,
            )
        )  # fmt: skip
        levels: list[RestLevel] = []
        if outcome.stop_reason is StopReason.CONTACT:
            levels = self._deeper(free)
        back = self._arm.dwell(0.05).pose_base_peg.pose()
        self._arm.slide(Pose(back.rotation, back.translation_m - self.normal * AWAY_M))
        return Press(free=free, levels=tuple(levels)) if len(levels) > 1 else None

    def _deeper(self, free: RestLevel) -> list[RestLevel]:
        level, outcome = self._level(HELD_S)
        levels = [level]
        joints, start = np.asarray(outcome.joints_rad), outcome.pose_base_peg.pose()
        corner, _ = touching_corner(self._peg, start.rotation, self.normal)
        along = self.normal @ jacobian_at(self._workcell, joints, corner)
        gives = float(along**2 @ (1.0 / np.asarray(self._workcell.joint_stiffness_nm_rad)))
        if self._workcell.contact_stiffness_n_m is not None:
            gives += 1.0 / self._workcell.contact_stiffness_n_m
        felt, gone = self._felt(free, level), 0.0
        first = felt
        if felt > MAX_LANDED * self._manner.force_n and self._touch_m_s > SLOWEST_M_S:
            # an arm that reacts late lands hard, and little is left to push
            self._touch_m_s = max(SLOWEST_M_S, self._touch_m_s * LANDED * self._manner.force_n / felt)
            self._console.print(
                f"  landed with {felt:.1f} N: touching with {self._touch_m_s * 1e3:.2f} mm/s from now on", style="dim",
                highlight=False,
            )  # fmt: skip
        for share in SHARES:
            wanted = share * self._manner.force_n - felt
            if wanted < 1.0:
                continue
            gone += wanted * gives
            self._arm.slide(Pose(start.rotation, start.translation_m + self.normal * gone), speed_m_s=0.001)
            level, _ = self._level(HELD_S)
            levels.append(level)
            felt = self._felt(free, level)
            gives = gone / max(felt - first, 0.5)  # with the wrench as measured
        return levels

    def _felt(self, free: RestLevel, level: RestLevel) -> float:
        pressed = held(Press(free=free, levels=(level,)), self._workcell)[0]
        return -float(wrench_base(pressed, self._workcell)[:3] @ self.normal)

    def weigh(self, home: Array) -> list[RestLevel]:
        """Dwells with the wrist turned about, clear of everything, each from home and back."""
        rng, arm = np.random.default_rng(self._manner.seed), self._workcell.arm()
        wide = self._collisions.margin_m + 0.005
        found: list[RestLevel] = []
        down = np.asarray(self._workcell.gravity_base_m_s2, float)
        down /= np.linalg.norm(down)
        directions: list[Array] = []
        tried = []
        for _ in range(WEIGHING_TRIES):
            joints = home.copy()
            joints[-3:] += rng.uniform(-WRIST_RAD, WRIST_RAD, 3)
            if arm.limits.violations(joints) or self._collisions.clearance(joints).distance_m < wide:
                continue
            tried.append((joints, down @ arm.pose_base_flange(joints).rotation))
        while tried and len(found) < WEIGHINGS:
            # the direction that is farthest from those already weighed in
            spread = [min((float(np.linalg.norm(way - one)) for one in directions), default=0.0) for _, way in tried]
            joints, way = tried.pop(int(np.argmax(spread)))
            if self._collisions.check_path([home, joints]) is not None:
                continue
            self._arm.go([joints])
            level, _ = self._level(FREE_S)
            found.append(level)
            directions.append(way)
            self._console.print(f"  weighed in orientation {len(found)} of {WEIGHINGS}", highlight=False)
            self._arm.go([home])
        return found


def tell_payload(session: Session, console: Console) -> SetPayload:
    """Set the payload, which the arm needs before it may touch; a sensor that was never calibrated is calibrated first.
    Raises as `Bus.call`.
    """
    known = session.bus.latest(FT_CALIBRATION).wait_for(lambda _: True, 10.0)
    if known is None or not known.calibrated:
        console.print("the force/torque sensor was never calibrated: doing it now", highlight=False)
        known = session.calibrate_ft(0.25)
    return SetPayload(
        bias=known.bias, weight_n=known.weight_n, centroid_ft_m=known.centroid_m, gravity_base=known.gravity_base
    )


def take_presses(
    session: Session, console: Console, manner: PressingManner, speed_share: float, what: str, weighed: bool,
    on_push: Callable[[Pressed], None] = lambda pressed: None,
) -> Pressed:  # fmt: skip
    """Push, and weigh where that is wanted; the arm ends where it began. `on_push` is called after each push with all
    data so far.

    Raises CalibrationRefused, CommandRefused, MoveEnded.
    """
    workcell = session.cell.workcell
    payload = tell_payload(session, console)
    presses: list[Press] = []
    weighings: list[RestLevel] = []
    with hold_arm(session.bus, f"calibrate {what}") as lease:
        arm = HeldArm(session.bus, lease, workcell, speed_share)
        arm.dwell(SETTLE_S)
        lease.ask(SET_PAYLOAD, payload, 10.0)
        home = arm.joints_rad.copy()
        presser = Presser(arm, console, manner)
        if weighed:
            weighings = presser.weigh(home)
        presser.to_front()
        presser.find_normal()
        shown = ", ".join(f"{value:+.4f}" for value in presser.normal)
        console.print(f"  the plate's normal is ({shown}) in the base", highlight=False)

        def so_far() -> Pressed:
            return Pressed.model_validate({
                "taken_at": now(), "cell": workcell.name, "normal_base": floats(presser.normal),
                "presses": tuple(presses), "weighings": tuple(weighings),
            })  # fmt: skip

        left = TimeLeft(manner.presses)
        for rotation, place in postures(workcell, manner.presses, manner.seed):
            if len(presses) >= manner.presses:
                break
            press = presser.press(rotation, place)
            if press is None:
                continue
            presses.append(press)
            said = f"  push {len(presses):2d} of {manner.presses}: {_told(press, presser.normal, workcell)}"
            console.print(said + left.after(len(presses)), highlight=False)
            on_push(so_far())
        presser.back_home(home)
    return so_far()


def _told(press: Press, normal: Array, workcell: Workcell) -> str:
    levels = held(press, workcell)
    force = [-float(wrench_base(level, workcell)[:3] @ normal) for level in levels]
    gone = float(normal @ (levels[-1].pose_base_peg.translation_m - levels[0].pose_base_peg.translation_m))
    return (
        f"{', '.join(f'{value:.1f}' for value in force)} N over {gone * 1e6:.0f} um: "
        f"{1e-3 * (force[-1] - force[0]) / max(gone, 1e-9):.0f} N/mm"
    )
