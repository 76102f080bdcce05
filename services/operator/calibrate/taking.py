"""Pictures of the board, shown by the arm or by a person; each pair is evaluated, and what is missing is reported."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.config.board import BoardPattern
from crosspih_common.errors import CommandRefused
from crosspih_common.holding import hold_arm
from crosspih_common.keys import CAMERA_CALIBRATION, JOINT_STATE
from crosspih_common.messages import CameraCalibration
from services.operator.assembly.session import Session
from services.operator.calibrate.folder import Taken, TakenPair, now, pair_job, save_taken, write_pair
from services.operator.calibrate.moving import SETTLE_S, HeldArm, captured
from services.operator.calibrate.page import DRAWN, LivePage
from services.operator.calibrate.showing import outline_px, tour
from services.operator.cli.time_left import TimeLeft
from services.operator.config import BoardSection
from services.operator.locate.worker import OfflineVision

VISION = "services.vision.calibration"
STEADY_S = 5.0


class Taker:
    """Takes pairs into a folder, draws each for people, and updates the page."""

    def __init__(
        self, session: Session, vision: OfflineVision, board: str, folder: Path, console: Console, page: LivePage | None
    ) -> None:
        self._session, self._vision, self._folder, self._console = session, vision, folder, console
        self._board, self._page = board, page
        self._pairs: list[TakenPair] = []
        self._jobs: list[dict[str, Any]] = []
        self.calibration: CameraCalibration | None = None

    def say(self, text: str) -> None:
        """Show the current step on the page."""
        if self._page is not None:
            self._page.say(text)

    def one(
        self, arm: HeldArm, joints_rad: tuple[float, ...] | None, next_px: list[list[list[float]]] | None = None
    ) -> None:
        """Take a pair, keep it and report what it shows. `next_px` is where the board is shown next. Raises
        CommandRefused.
        """
        told, left, right = arm.look()
        self.calibration = told.calibration
        number = len(self._pairs)
        pair = write_pair(self._folder, number, left, right, joints_rad)
        job = pair_job(pair, self._folder, told.calibration.left.gamma.value)
        draw = {side: str(self._folder / file) for side, file in DRAWN.items()}
        seen = ask(self._vision, {
            "do": "see", "board": self._board, "pair": job, "pairs": self._jobs, "draw": {**draw, "wanted": next_px},
        })  # fmt: skip
        self._pairs.append(pair)
        self._jobs.append(job)
        if self._page is not None:
            self._page.add(seen)
        lacking = list(seen["missing"])
        more = f" (and {len(lacking) - 1} more)" if len(lacking) > 1 else ""
        missing = f"; missing: {lacking[0]}{more}" if lacking else ""
        self._console.print(
            f"  pair {number + 1:2d}: {seen['left']} and {seen['right']} of {seen['all']} corners, {seen['both']} in "
            f"both{missing}",
            highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip
        self.save()

    def save(self) -> Taken:
        """Save the list of pairs so far beside the pictures."""
        taken = Taken.model_validate({
            "taken_at": now(), "cell": self._session.cell.workcell.name, "board": self._board,
            "calibration": self.calibration, "pairs": tuple(self._pairs),
        })  # fmt: skip
        save_taken(self._folder, taken)
        return taken


def ask(vision: OfflineVision, job: dict[str, Any]) -> dict[str, Any]:
    """The answer of the vision process. Raises BadInput, VisionLost, CalibrationRefused."""
    answer = vision.ask(job)
    if "refused" in answer:
        raise CalibrationRefused(str(answer["refused"]))
    return answer


def doubt_of(stereo: dict[str, Any]) -> dict[str, Any]:
    """The uncertainty of the cameras found by `stereo`, for `hand_eye`."""
    return {
        "model": stereo["model"], "values": [one["value"] for one in stereo["values"]],
        "covariance": stereo["covariance"],
    }  # fmt: skip


def take_by_arm(
    session: Session, vision: OfflineVision, board: BoardSection, count: int, folder: Path, console: Console,
    speed_share: float, what: str, seed: int = 0, page: LivePage | None = None,
) -> Taken:  # fmt: skip
    """The arm shows the board in this many postures and returns to where it began.

    Raises CalibrationRefused where the board cannot be shown, CommandRefused, MoveEnded.
    """
    taker = Taker(session, vision, board.pattern, folder, console, page)
    pattern, on_flange = BoardPattern.of(board.pattern), board.pose_flange_board.pose()
    workcell = session.cell.workcell
    with hold_arm(session.bus, f"calibrate {what}") as lease:
        arm = HeldArm(session.bus, lease, workcell, speed_share)
        arm.dwell(SETTLE_S)
        told = cameras_of(session)
        console.print("choosing postures in which both cameras see the board", highlight=False)
        taker.say("choosing postures in which both cameras see the board")
        ways = tour(workcell, told, pattern, on_flange, arm.joints_rad, count, seed)
        left = TimeLeft(len(ways) - 1)
        for index, way in enumerate(ways[:-1]):
            going = f"posture {index + 1} of {len(ways) - 1}{left.after(index)}"
            taker.say(going)
            console.print(going, highlight=False)
            try:
                arm.go(way[1:])
            except CommandRefused as refusal:
                console.print(f"  left out: {refusal}", style="yellow", highlight=False, markup=False, soft_wrap=True)
                if not np.allclose(arm.joints_rad, way[0], atol=1e-3):
                    raise
                continue
            settled = arm.dwell(SETTLE_S)
            after = None
            if index + 2 < len(ways):
                after = outline_px(workcell, told, pattern, on_flange, ways[index + 1][-1])
            taker.one(arm, settled.joints_rad, after)
        taker.say("back to where the arm began")
        arm.go(ways[-1][1:])
    return taker.save()


def take_by_hand(
    session: Session, vision: OfflineVision, board: str, folder: Path, console: Console, poses: bool,
    next_one: Callable[[str], bool], page: LivePage | None = None,
) -> Taken:  # fmt: skip
    """A person shows the board, or moves the arm that does; `next_one` asks for the next pair and returns False to
    finish.
    """
    taker = Taker(session, vision, board, folder, console, page)
    taker.say("show the board where a part of the picture is tinted, and tilted as the list says; Enter takes a pair")
    with session.bus.reading(JOINT_STATE, 4) as states, hold_arm(session.bus, "calibrate by hand") as lease:
        arm = HeldArm(session.bus, lease, session.cell.workcell)
        while next_one("Enter takes a pair, q ends"):
            joints = None
            if poses:
                state = states.value()
                if state is None:
                    raise CommandRefused("no_joints", "the encoders say nothing (arm/joint_state)")
                joints = state.joints_rad
            taker.one(arm, joints)
    return taker.save()


def cameras_of(session: Session) -> CameraCalibration:
    """The calibration that the camera publishes; a picture is taken first where none has come yet. Raises as
    `Bus.call`.
    """
    told = session.bus.latest(CAMERA_CALIBRATION).wait_for(lambda _: True, STEADY_S)
    return told if told is not None else captured(session.bus).calibration
