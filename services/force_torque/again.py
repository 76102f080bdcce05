"""`python -m services.force_torque.again FILE --cell CELL`: processes a recording's samples again, for
`crosspih replay`.

Each recorded wrench names the joint state and the calibration that it was computed with, so the order in which samples
reached the service does not matter. Processing starts at the first wrench that carries the service's memory, and
restarts after a gap: a sample that was not recorded.
"""

from __future__ import annotations

import sys
from bisect import bisect_right

from crosspih_common.config import CellFile
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import (
    CLASSIFY,
    COMPENSATE,
    CONTACT_STATE,
    CONTACT_WRENCH,
    FT_CALIBRATION,
    IDENTIFY_PAYLOAD,
    JOINT_STATE,
    REFUSAL,
    WRENCH_RAW,
)
from crosspih_common.messages import ContactWrench, FtCalibration, JointState, RawWrenchBatch
from crosspih_common.recording import OVERTAKEN_NS, Recording
from crosspih_common.recording.rerun import Rerun, run_again
from services.force_torque.answering import calibration_message, classified, compensated, identified, payload_of
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.stream import JOINT_STATES, WrenchStream

COMMANDS = (COMPENSATE, CLASSIFY, IDENTIFY_PAYLOAD)
TOPICS = (
    JOINT_STATE, WRENCH_RAW, CONTACT_WRENCH, CONTACT_STATE, FT_CALIBRATION, REFUSAL,
    *(echo for command in COMMANDS for echo in (command.request_echo, command.reply_echo)),
)  # fmt: skip
WRENCHES, STATES, ANSWERS = "wrenches", "contact states", "answers"
OF_BEFORE = "recorded before it was told what each contact wrench went by: the stream cannot be gone through again"
OF_A_FILE = frozenset({"date", "file"})
MEMORY = frozenset({"memory"})  # a difference in memory shows in the wrenches


def rerun(recording: Recording, cell: CellFile, from_ns: int, outcome: Rerun) -> None:
    """Recompute the stream and the answers, and compare them with the recording."""
    config = cell.section("force_torque", ForceTorqueConfig)
    judge = Judge(cell.workcell, config.contact_classifier)
    _Stream(recording, cell, WrenchStream(cell.workcell, config, judge), outcome).compare(from_ns)
    _answers(recording, cell, config, judge, from_ns, outcome)


class _Stream:
    """The samples of a recording, found by the references in the recorded wrenches."""

    def __init__(self, recording: Recording, cell: CellFile, stream: WrenchStream, outcome: Rerun) -> None:
        self._workcell, self._stream, self._outcome = cell.workcell, stream, outcome
        self._wrenches = recording.messages(CONTACT_WRENCH)
        self._batches = {_end_ns(batch): batch for batch in recording.messages(WRENCH_RAW)}
        self._joints = recording.messages(JOINT_STATE)
        self._of_stamp = {state.stamp_ns: index for index, state in enumerate(self._joints)}
        self._calibrations = {one.seq: one for one in recording.messages(FT_CALIBRATION)}
        self._said = {state.stamp_ns: state for state in recording.messages(CONTACT_STATE)}

    def compare(self, from_ns: int) -> None:
        """Process all samples and compare."""
        wrenches = [one for one in self._wrenches if one.stamp_ns >= from_ns]
        if not wrenches:
            return
        if all(one.joint_stamp_ns < 0 for one in wrenches):
            self._outcome.notes.append(OF_BEFORE)
            return
        gaps, at_a_loss, before = 0, True, None
        for wrench in wrenches:
            known = self._states(wrench)
            batch = self._batches.get(wrench.stamp_ns)
            whole = known is not None and batch is not None and (before is None or wrench.seq == before.seq + 1)
            if not at_a_loss and not whole:
                gaps, at_a_loss = gaps + 1, True
            before = wrench
            if at_a_loss:
                at_a_loss = known is None or not self._begin(wrench)
            elif batch is not None and known is not None and self._use(wrench):
                self._one(wrench, batch, known)
            else:
                at_a_loss = True
        if gaps:
            self._outcome.notes.append(f"samples are missing in {gaps} places: gone on at the next memory after each")

    def _states(self, wrench: ContactWrench) -> list[JointState] | None:
        """The last states up to the named one; None if not enough of them are recorded."""
        index = self._of_stamp.get(wrench.joint_stamp_ns)
        if index is None or index + 1 < JOINT_STATES:
            return None
        return self._joints[index + 1 - JOINT_STATES : index + 1]

    def _begin(self, wrench: ContactWrench) -> bool:
        """Whether processing can start after this wrench."""
        if wrench.memory is None or not self._use(wrench):
            return False
        self._stream.remember(wrench)
        return True

    def _use(self, wrench: ContactWrench) -> bool:
        """Use the calibration that the wrench names; False if it is not recorded, or not to the last bit."""
        if wrench.calibration_seq == self._stream.calibration_seq:
            return True
        told = self._calibrations.get(wrench.calibration_seq)
        payload = None if told is None else payload_of(told, self._workcell)
        if payload is None:
            return False
        self._stream.use(payload, wrench.calibration_seq)
        return True

    def _one(self, wrench: ContactWrench, batch: RawWrenchBatch, states: list[JointState]) -> None:
        told = self._stream.take(batch, states)
        self._outcome.compare(WRENCHES, CONTACT_WRENCH.path, wrench.stamp_ns, wrench, told.wrench, MEMORY)
        then, now = self._said.get(wrench.stamp_ns), told.state
        if then is not None and now is not None:
            self._outcome.compare(STATES, CONTACT_STATE.path, wrench.stamp_ns, then, now)
        elif then is not None or now is not None:
            self._outcome.count(STATES, False)


def _end_ns(batch: RawWrenchBatch) -> int:
    return batch.stamp_ns + batch.period_ns * (len(batch.samples) - 1)


def _answers(
    recording: Recording, cell: CellFile, config: ForceTorqueConfig, judge: Judge, from_ns: int, outcome: Rerun
) -> None:
    """Compare requests and answers. Refused requests are skipped; answered ones must be answered again."""
    calibrations = recording.sent(FT_CALIBRATION)

    def known(wall_ns: int) -> FtCalibration | None:
        index = bisect_right([one.wall_ns for one in calibrations], wall_ns + OVERTAKEN_NS)
        return calibrations[index - 1].value if index else None

    for request, reply in recording.answered(COMPENSATE):
        told = known(request.wall_ns)
        payload = None if told is None else payload_of(told, cell.workcell)
        if reply is not None and payload is not None and request.value.stamp_ns >= from_ns:
            now = compensated(payload, judge, request.value)
            outcome.compare(ANSWERS, COMPENSATE.path, request.value.stamp_ns, reply.value, now)
    for asked, states in recording.answered(CLASSIFY):
        if states is not None and asked.value.stamp_ns >= from_ns:
            now_states = classified(judge, asked.value)
            outcome.compare(ANSWERS, CLASSIFY.path, asked.value.stamp_ns, states.value, now_states)
    for dwells, found in recording.answered(IDENTIFY_PAYLOAD):
        if found is None or found.value.weight_base_n is None or dwells.value.stamp_ns < from_ns:
            continue
        try:
            again = calibration_message(*identified(cell.workcell, config, dwells.value), "")
        except CommandRefused as refusal:
            outcome.count(ANSWERS, False)
            outcome.notes.append(f"{IDENTIFY_PAYLOAD.path}: was answered, and is refused now: {refusal}")
            continue
        outcome.compare(ANSWERS, IDENTIFY_PAYLOAD.path, dwells.value.stamp_ns, found.value, again, OF_A_FILE)


if __name__ == "__main__":
    sys.exit(run_again(TOPICS, rerun))
