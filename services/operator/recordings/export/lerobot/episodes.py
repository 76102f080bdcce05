"""An assembly as an episode: at each step of a fixed rate the values of the last message before it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import ASSEMBLE, CONTACT_WRENCH, IMAGE_LEFT, IMAGE_RIGHT, JOINT_STATE, PHASE, Topic
from crosspih_common.messages import Image, Phase, PoseData
from crosspih_common.recording import Recording

PHASES = tuple(phase.value for phase in Phase)
SIDES = {"left": IMAGE_LEFT, "right": IMAGE_RIGHT}
NEEDED: tuple[Topic[Any], ...] = (
    ASSEMBLE.request_echo, ASSEMBLE.reply_echo, CONTACT_WRENCH, IMAGE_LEFT, IMAGE_RIGHT, JOINT_STATE, PHASE
)  # fmt: skip
Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """One assembly at n steps: `joints_rad`, `speeds_rad_s` (n, joints), `wrench` (n, 6) of contact in the peg frame,
    `peg` (n, 7) position and quaternion x, y, z, w in the base, `phases` (n,) numbers of PHASES.

    `pictures` has for each side the index of the picture at each step (n,), -1 before the first, and the pictures.
    """

    task: str
    inserted: bool
    joints_rad: Array
    speeds_rad_s: Array
    wrench: Array
    peg: Array
    phases: NDArray[np.int64]
    pictures: dict[str, tuple[NDArray[np.int64], list[Pixels]]]

    @property
    def length(self) -> int:
        """Steps."""
        return len(self.joints_rad)

    @property
    def action(self) -> Array:
        """(n, joints): the joints one step later; the arm is commanded by whole motions, not step by step."""
        return np.concatenate([self.joints_rad[1:], self.joints_rad[-1:]])


def episodes_of(recording: Recording, workcell: Workcell, fps: int) -> Iterator[Episode]:
    """Every assembly that has a result, in order."""
    joints = recording.messages(JOINT_STATE)
    wrenches = recording.messages(CONTACT_WRENCH)
    steps = recording.messages(PHASE)
    pictures = {side: recording.messages(topic) for side, topic in SIDES.items()}
    outline = workcell.peg.outline
    for request, reply in recording.answered(ASSEMBLE):
        if reply is None:
            continue
        first, last = request.value.stamp_ns, reply.value.stamp_ns
        times = np.arange(first, last + 1, round(1e9 / fps), dtype=np.int64)
        if not joints:
            continue
        index = np.maximum(_held(times, joints), 0)  # before the first joint state: the values of that one
        angles = np.array([joints[i].joints_rad for i in index])
        felt = _held(times, wrenches)
        said = _held(times, steps)
        shown = {side: _held(times, taken) for side, taken in pictures.items()}
        yield Episode(
            task=f"put the {outline} peg into its hole ({request.value.strategy.value})",
            inserted=reply.value.inserted,
            joints_rad=angles,
            speeds_rad_s=np.array([joints[i].speeds_rad_s for i in index]),
            wrench=np.array([wrenches[i].wrench if i >= 0 else (0.0,) * 6 for i in felt]).reshape(-1, 6),
            peg=np.array([_peg_of(workcell, row) for row in angles]),
            phases=np.array([PHASES.index(steps[i].phase.value) if i >= 0 else 0 for i in said]),
            pictures={side: (numbers, [_rgb(one) for one in pictures[side]]) for side, numbers in shown.items()},
        )


def _held(times: NDArray[np.int64], messages: Sequence[Any]) -> NDArray[np.int64]:
    """The index of the last message up to each time; -1 where there is none yet."""
    stamps = np.maximum.accumulate(np.array([message.stamp_ns for message in messages], dtype=np.int64))
    return np.asarray(np.searchsorted(stamps, times, side="right") - 1, dtype=np.int64)


def _peg_of(workcell: Workcell, joints_rad: Array) -> tuple[float, ...]:
    pose = PoseData.of(workcell.pose_base_peg(joints_rad))
    return (*pose.position_m, *pose.quaternion_xyzw)


def _rgb(image: Image) -> Pixels:
    """(height, width, 3), 8 bits, both sizes even as video needs them; a Bayer picture is not demosaiced but shown in
    grey.
    """
    pixels = image.pixels >> 8 if image.pixels.dtype == np.uint16 else image.pixels
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    elif image.encoding == "bgr8":
        pixels = pixels[:, :, ::-1]
    height, width = pixels.shape[:2]
    padded = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return np.ascontiguousarray(padded, dtype=np.uint8)
