"""Pictures of the board, taken while the arm shows it or a person does; each is looked at, and what is missing told."""

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
from services.operator.calibrate.folder import Taken, TakenPair, encoding_of, now, pair_job, save_taken, write_picture
from services.operator.calibrate.moving import SETTLE_S, HeldArm, captured
from services.operator.calibrate.showing import tour
from services.operator.config import BoardSection
from services.operator.locate.worker import OfflineVision
from services.operator.session import Session

VISION = "services.vision.calibration"
STEADY_S = 5.0


class Taker:
    """Takes pairs into a folder."""

    def __init__(self, session: Session, vision: OfflineVision, board: str, folder: Path, console: Console) -> None:
        self._session, self._vision, self._folder, self._console = session, vision, folder, console
        self._board = board
        self._pairs: list[TakenPair] = []
        self._jobs: list[dict[str, Any]] = []
        self.calibration: CameraCalibration | None = None

    def one(self, arm: HeldArm, joints_rad: np.ndarray[Any, np.dtype[np.float64]] | None) -> dict[str, Any]:
        """Take a pair, keep it and say what it shows. Raises CommandRefused."""
        told, left, right = arm.look()
        self.calibration = told.calibration
        number = len(self._pairs)
        names = f"pair-{number:03d}-left", f"pair-{number:03d}-right"
        files = []
        for name, image in zip(names, (left, right), strict=True):
            file = name + (".ppm" if image.pixels.ndim == 3 else ".pgm")
            write_picture(image, self._folder / file)
            files.append(file)
        pair = TakenPair(
            left=files[0], right=files[1], encodings=(encoding_of(left), encoding_of(right)),
            joints_rad=None if joints_rad is None else tuple(float(value) for value in joints_rad),
        )  # fmt: skip
        job = pair_job(pair, self._folder, told.calibration.left.gamma.value)
        seen = ask(self._vision, {"do": "see", "board": self._board, "pair": job, "pairs": self._jobs})
        self._pairs.append(pair)
        self._jobs.append(job)
        missing = f"; missing: {seen['missing'][0]}" if seen["missing"] else ""
        self._console.print(
            f"  pair {number + 1:2d}: {seen['left']} and {seen['right']} of {seen['all']} corners, {seen['both']} in "
            f"both{missing}",
            highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip
        self.save()
        return seen

    def save(self) -> Taken:
        """What there is so far, beside the pictures."""
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
    """How surely `stereo` knew the cameras, for `hand_eye`."""
    return {
        "model": stereo["model"], "values": [one["value"] for one in stereo["values"]],
        "covariance": stereo["covariance"],
    }  # fmt: skip


def take_by_arm(
    session: Session, vision: OfflineVision, board: BoardSection, count: int, folder: Path, console: Console,
    speed_share: float, what: str, seed: int = 0,
) -> Taken:  # fmt: skip
    """The arm shows the board in so many postures and goes back to where it began.

    Raises CalibrationRefused where the board cannot be shown, CommandRefused, MoveEnded.
    """
    taker = Taker(session, vision, board.pattern, folder, console)
    workcell = session.cell.workcell
    with hold_arm(session.bus, f"calibrate {what}") as lease:
        arm = HeldArm(session.bus, lease, workcell, speed_share)
        arm.dwell(SETTLE_S)
        told = cameras_of(session)
        console.print("choosing postures in which both cameras see the board", highlight=False)
        ways = tour(
            workcell, told, BoardPattern.of(board.pattern), board.pose_flange_board.pose(), arm.joints_rad, count, seed
        )
        for way in ways[:-1]:
            try:
                arm.go(way[1:])
            except CommandRefused as refusal:
                console.print(f"  left out: {refusal}", style="yellow", highlight=False, markup=False, soft_wrap=True)
                if not np.allclose(arm.joints_rad, way[0], atol=1e-3):
                    raise
                continue
            settled = arm.dwell(SETTLE_S)
            taker.one(arm, np.asarray(settled.joints_rad))
        arm.go(ways[-1][1:])
    return taker.save()


def take_by_hand(
    session: Session, vision: OfflineVision, board: str, folder: Path, console: Console, poses: bool,
    next_one: Callable[[str], bool],
) -> Taken:  # fmt: skip
    """A person shows the board, or moves the arm that does; `next_one` asks for the next pair, False: enough."""
    taker = Taker(session, vision, board, folder, console)
    with session.bus.hearing(JOINT_STATE, 4) as states, hold_arm(session.bus, "calibrate by hand") as lease:
        arm = HeldArm(session.bus, lease, session.cell.workcell)
        while next_one("Enter takes a pair, q ends"):
            joints = None
            if poses:
                state = states.value()
                if state is None:
                    raise CommandRefused("no_joints", "the encoders say nothing (arm/joint_state)")
                joints = np.asarray(state.joints_rad, float)
            taker.one(arm, joints)
    return taker.save()


def cameras_of(session: Session) -> CameraCalibration:
    """What the camera says of itself; a picture is taken where it has not said so yet. Raises as `Bus.call`."""
    told = session.bus.latest(CAMERA_CALIBRATION).wait_for(lambda _: True, STEADY_S)
    return told if told is not None else captured(session.bus).calibration
