"""The planner's ports that answer from a recording: what was refused then is refused, what differs first is told."""

from __future__ import annotations

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.bus.codec import label_of
from crosspih_common.bus.traffic import KeyCounters
from crosspih_common.bus.transport import Tap
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import DWELL, LOCATE, REFUSAL, Topic
from crosspih_common.messages import (
    AssemblyResult,
    CommandRefusal,
    Dwell,
    Failure,
    LocateHole,
    LocateMethod,
    Message,
    MotionOutcome,
    PoseData,
    StopReason,
    Strategy,
)
from crosspih_common.recording import Recorded, Recording
from crosspih_common.recording.rerun import Rerun
from services.planning.again import Departed, RecordedPorts, RecordedRequest, Untold, steps_of
from services.planning.ports import AssemblyFailed

POSE = PoseData(position_m=(0.4, -0.3, 0.2), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
SIX = (0.0,) * 6


def outcome(stamp_ns: int) -> MotionOutcome:
    return MotionOutcome(
        stamp_ns=stamp_ns, start_stamp_ns=stamp_ns, stop_reason=StopReason.COMPLETED, duration_s=0.05, travel_m=0.0,
        joints_rad=SIX, pose_base_peg=POSE, wrench_raw=SIX, wrench_sd=SIX, peak_force_n=0.0, peak_moment_nm=0.0,
    )  # fmt: skip


def refused(code: str) -> CommandRefusal:
    return CommandRefusal(command=LOCATE.path, request_seq=0, refused=code, text="because")


def ports(*steps: RecordedRequest, result: AssemblyResult | None = None) -> tuple[RecordedPorts, Rerun]:
    told = Rerun(0)
    return RecordedPorts(list(steps), None, result, told), told


def dwell(duration_s: float = 0.05, stamp_ns: int = 1) -> RecordedRequest:
    request = Dwell(stamp_ns=stamp_ns, seq=0, duration_s=duration_s, lease="theirs")
    return RecordedRequest(DWELL, request, stamp_ns, outcome(stamp_ns), None)


def test_the_recorded_answer_is_given_to_the_same_request_whoever_held_the_arm() -> None:
    here, told = ports(dwell(), dwell(0.25, 2))
    assert here.ask(DWELL, Dwell(duration_s=0.05)) == outcome(1)
    assert here.ask(DWELL, Dwell(duration_s=0.25)).stamp_ns == 2
    assert told.parts == {"requests": [2, 2]} and here.left is None


def test_a_stream_that_had_said_nothing_has_the_arm_hold_still_once_more() -> None:
    here, _ = ports(dwell(), dwell(stamp_ns=2))
    assert here.look(lambda: here.ask(DWELL, Dwell(duration_s=0.05))).stamp_ns == 2


def test_another_request_ends_it_and_says_what_differs() -> None:
    here, told = ports(dwell())
    with pytest.raises(Departed) as departed:
        here.ask(DWELL, Dwell(duration_s=0.06))
    assert [(row.field, row.then, row.now) for row in departed.value.rows] == [("duration_s", "0.05", "0.06")]
    here, told = ports(dwell())
    with pytest.raises(Departed) as departed:
        here.ask(LOCATE, LocateHole(method=LocateMethod.PAPER))
    assert [(row.then, row.now) for row in departed.value.rows] == [(DWELL.path, LOCATE.path)]
    assert told.parts == {"requests": [0, 1]}


def test_what_was_refused_then_is_refused_with_the_same_words() -> None:
    here, _ = ports(RecordedRequest(LOCATE, LocateHole(stamp_ns=1, seq=0), 1, None, refused("no_hole")))
    with pytest.raises(CommandRefused, match="no_hole: because"):
        here.ask(LOCATE, LocateHole())
    here, _ = ports(RecordedRequest(LOCATE, LocateHole(stamp_ns=1, seq=0), 1, None, refused("no_lease")))
    with pytest.raises(AssemblyFailed, match="arm_stopped"):
        here.ask(LOCATE, LocateHole())
    again = RecordedRequest(
        LOCATE, LocateHole(stamp_ns=2, seq=1), 2, POSE_FOUND, None
    )  # the arm was taken anew, to back off
    here, _ = ports(RecordedRequest(LOCATE, LocateHole(stamp_ns=1, seq=0), 1, None, refused("no_lease")), again)
    here.ignore_abort()
    found: Message = here.ask(LOCATE, LocateHole())
    assert found == POSE_FOUND


POSE_FOUND = outcome(7)  # any message does for an answer


def test_what_the_bus_did_is_done_again_and_what_nobody_tells_ends_it() -> None:
    unanswered = RecordedRequest(LOCATE, LocateHole(stamp_ns=1, seq=0), 1, None, None)
    here, _ = ports(unanswered)
    with pytest.raises(Untold, match="neither an answer nor a refusal"):
        here.ask(LOCATE, LocateHole())
    lost = AssemblyResult(
        assembly_id="a", strategy=Strategy.FUSED, inserted=False, failure=Failure.SERVICE_LOST,
        failure_detail="vision: gone", backed_off=True, pose_base_hole=None, covariance=None, rank=None,
        pose_base_peg=POSE, vision_pose_base_hole=None, motion_s=0.0, thinking_s=0.0,
        touches=0, presses=0, corrections=0, pushes=0,
        peak_force_n=0.0, peak_moment_nm=0.0, insertion_depth_m=0.0,
    )  # fmt: skip
    here, _ = ports(unanswered, result=lost)
    with pytest.raises(AssemblyFailed) as failed:
        here.ask(LOCATE, LocateHole())
    assert failed.value.failure is Failure.SERVICE_LOST and failed.value.lost == "vision"


def test_a_refusal_on_the_bus_names_the_request_and_its_answer_is_not_another_ones() -> None:
    recording = Recording.empty("a.mcap")

    def record(topic: Topic[Message]) -> None:
        def taker(key: str, counts: KeyCounters) -> Tap:
            samples = recording.samples.setdefault(key, [])
            label = label_of(topic.type)
            return lambda payload, number: samples.append(Recorded(key, label, payload, number, 0, len(samples) + 1))

        recorder.tap(topic, taker)

    hub = MemoryHub()
    with Bus(hub.transport(), "c", "recorder") as recorder, Bus(hub.transport(), "c", "hardware") as hardware:
        for topic in (DWELL.request_echo, DWELL.reply_echo, REFUSAL):
            record(topic)  # type: ignore[arg-type]

        def serve(request: Dwell) -> MotionOutcome:
            if request.duration_s > 0.1:
                raise CommandRefused("too_long", "want less")
            return outcome(5)

        hardware.serve(DWELL, serve)
        with Bus(hub.transport(), "c", "planning") as planning:
            for duration_s in (0.2, 0.05):
                try:
                    planning.call(DWELL, Dwell(duration_s=duration_s), 5.0)
                except CommandRefused as refusal:
                    assert refusal.code == "too_long"
    pairs = [(request.value.duration_s, reply is not None) for request, reply in recording.answered(DWELL)]
    assert pairs == [(0.2, False), (0.05, True)]
    assert recording.refusals(DWELL)[0].text == "want less"
    steps = steps_of(recording, 0, 1_000)
    assert [step.refusal.refused if step.refusal else "answered" for step in steps] == ["too_long", "answered"]
