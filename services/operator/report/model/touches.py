"""The contacts: touches on the way in, and presses against the bore's walls after insertion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.keys import ESTIMATE, NETWORK, SEATED, SEQUENCE_NETWORK, TOUCH
from crosspih_common.messages import PoseErrorEstimate, Touch, TouchUse
from crosspih_common.recording import Recording, Sent
from services.operator.report.model.forces import Trace
from services.operator.report.model.motion import AnsweredMotion
from services.operator.report.model.window import AssemblyWindow


@dataclass(frozen=True, slots=True)
class TouchEntry:
    """A touch, its number among its kind, the time of its largest force, the conclusions from it and from all before,
    and the last estimate's evaluation of it.
    """

    number: int
    touch: Touch
    time_s: float
    estimate: PoseErrorEstimate | None
    use: TouchUse | None


def touches_of(
    recording: Recording, window: AssemblyWindow, motions: list[AnsweredMotion], trace: Trace | None
) -> tuple[list[TouchEntry], list[TouchEntry]]:
    """(touches on the way in, presses once seated), each in order; the time of each is that of the largest force within
    its motion.
    """
    touches = [sent for sent in recording.sent(TOUCH) if window.holds(sent.value.stamp_ns)]
    answers: list[Sent[PoseErrorEstimate]] = []
    for command in (ESTIMATE, NETWORK, SEQUENCE_NETWORK, SEATED):
        answers += [sent for sent in recording.sent(command.reply_echo) if window.holds(sent.value.stamp_ns)]
    answers.sort(key=lambda sent: sent.wall_ns)
    uses = {use.index: use for answer in answers for use in answer.value.rests_on}
    felt: list[TouchEntry] = []
    pressed: list[TouchEntry] = []
    for index, sent in enumerate(touches):
        until = touches[index + 1].wall_ns if index + 1 < len(touches) else None
        after = [
            answer.value
            for answer in answers
            if answer.wall_ns >= sent.wall_ns and (until is None or answer.wall_ns < until)
        ]
        among = pressed if sent.value.seated else felt
        among.append(
            TouchEntry(
                len(among) + 1,
                sent.value,
                _felt_s(window.s(sent.value.stamp_ns), motions, trace),
                after[0] if after else None,
                uses.get(sent.value.index),
            )
        )
    return felt, pressed


def _felt_s(told_s: float, motions: list[AnsweredMotion], trace: Trace | None) -> float:
    """When the force was largest in the motion at whose end a touch is stamped; that end where it is not known."""
    motion = next((motion for motion in motions if abs(motion.end_s - told_s) < 1e-6), None)
    if motion is None or trace is None:
        return told_s
    within = np.flatnonzero((trace.time_s >= motion.start_s) & (trace.time_s <= motion.end_s))
    return told_s if not len(within) else float(trace.time_s[within[int(np.argmax(trace.force_n[within]))]])
