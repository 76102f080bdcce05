"""The action `assemble` against zenoh-ros2-sdk's services and subscribers, each part of it under its own key."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("zenoh_ros2_sdk")

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.keys import ABORT, ASSEMBLE, PHASE
from crosspih_common.messages import (
    AbortAccepted,
    AbortAssembly,
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    Failure,
    Phase,
    PoseData,
    Strategy,
)
from crosspih_common.ros2 import Entity, RosNode, RosQos, RosTypes, actions
from services.ros2.action import DEFINITION, NAME
from tests.conftest import ServiceProcess
from tests.ros2.sdk import SdkProcess

T2 = PoseData(position_m=(0.4, -0.3, 0.2), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))


class Planner:
    """Planning's place on the bus: an assembly says a phase, and ends when it is let go or aborted."""

    def __init__(self, endpoint: str) -> None:
        self.bus = Bus(open_zenoh(endpoint), "cell1", "planning")
        self.asked: list[Assemble] = []
        self.begun, self.let_go, self.aborted = threading.Event(), threading.Event(), threading.Event()
        self.bus.serve(ASSEMBLE, self._assemble)
        self.bus.serve(ABORT, self._abort, lane="now")

    def _assemble(self, request: Assemble) -> AssemblyResult:
        self.asked.append(request)
        self.aborted.clear()
        phase = AssemblyPhase(assembly_id=request.assembly_id, phase=Phase.PUSHING, text="pushing with 12 N")
        self.bus.publisher(PHASE).publish(phase.model_copy(update={"assembly_id": "somebody else's"}))
        self.bus.publisher(PHASE).publish(phase)
        self.begun.set()
        assert self.let_go.wait(30.0)
        self.begun.clear()
        self.let_go.clear()
        failure = Failure.ABORTED if self.aborted.is_set() else None
        return AssemblyResult(
            assembly_id=request.assembly_id, strategy=request.strategy, inserted=failure is None, failure=failure,
            backed_off=failure is not None, pose_base_hole=T2 if failure is None else None, pose_base_peg=None,
            vision_pose_base_hole=None, motion_s=12.0, thinking_s=0.5, touches=0, presses=4, corrections=0, pushes=1,
            peak_force_n=6.25, peak_moment_nm=0.5, insertion_depth_m=0.0251,
        )  # fmt: skip

    def _abort(self, request: AbortAssembly) -> AbortAccepted:
        running = self.begun.is_set()
        self.aborted.set()
        self.let_go.set()
        return AbortAccepted(was_running=running)


@pytest.fixture
def planner(endpoint: str) -> Iterator[Planner]:
    there = Planner(endpoint)
    yield there
    there.let_go.set()
    there.bus.close()


def hashes_of(types: RosTypes) -> str:
    """What the SDK, which has no rosidl, is told of the action's types."""
    actions.add_action(types, NAME, DEFINITION.read_text(encoding="utf-8"))
    kinds = (f"{NAME}_SendGoal", f"{NAME}_GetResult", f"{NAME}_FeedbackMessage", actions.CANCEL)
    return json.dumps({kind: types.hash(kind) for kind in kinds})


def test_a_goal_ends_by_name_when_planning_is_killed(
    endpoint: str, sdk: Callable[..., SdkProcess], spawn: Callable[..., ServiceProcess]
) -> None:
    """There is no arm: planning asks for its lease, and is killed in that."""
    bridge, planning = spawn("ros2", "--endpoint", endpoint), spawn("planning", "--endpoint", endpoint)
    lives, begun = threading.Event(), threading.Event()
    with Bus(open_zenoh(endpoint), "cell1", "operator") as bus:
        bus.watch_alive(lambda service, alive: lives.set() if service == planning.name and alive else None)
        bus.subscribe_inline(ASSEMBLE.request_echo, lambda request: begun.set())
        assert bridge.wait_for_line("node /crosspih in domain 0") and lives.wait(30.0)
        goal = sdk("act", "--hashes", hashes_of(RosTypes()))
        assert goal.said("accepted")["accepted"] and begun.wait(20.0)
        planning.kill()
        ended = goal.said("status", deadline_s=10.0)
    assert (ended["status"], ended["inserted"], ended["failure"]) == (actions.ABORTED, False, "service_lost")
    assert "the peg may be in the hole" in ended["text"]


def test_a_goal_has_feedback_and_a_result_and_another_is_cancelled(
    endpoint: str, planner: Planner, sdk: Callable[..., SdkProcess], spawn: Callable[..., ServiceProcess]
) -> None:
    bridge = spawn("ros2", "--endpoint", endpoint)
    assert bridge.wait_for_line("node /crosspih in domain 0")
    types = RosTypes()
    hashes = hashes_of(types)
    told: list[int] = []

    first = sdk("act", "--hashes", hashes, "--strategy", "force_alone")
    accepted, feedback = first.said_all("accepted", "feedback")
    assert accepted["accepted"] and planner.begun.wait(20.0)
    second, triggered = sdk("act", "--hashes", hashes), sdk("call", "/assemble")
    assert feedback["feedback"] == ["pushing", "pushing with 12 N"]
    assert not second.said("accepted")["accepted"]  # one at a time, and nothing is queued
    assert triggered.said("success")["message"].startswith("busy")
    planner.let_go.set()
    ended = first.said("status")
    assert (ended["status"], ended["inserted"], ended["failure"]) == (actions.SUCCEEDED, True, "")
    assert ended["text"] == "inserted, 25.1 mm deep, 12.5 s, peak 6.2 N" and ended["depth"] == 0.0251
    assert ended["frame"] == "base_link" and ended["hole"] == [0.4, -0.3, 0.2, 0.0, 0.0, 0.0, 1.0]
    assert planner.asked[0].strategy is Strategy.FORCE_ALONE

    cancelled = sdk("act", "--hashes", hashes, "--cancel")
    assert cancelled.said("cancelled") == {"cancelled": actions.CANCEL_NONE, "goals": 1}
    ended = cancelled.said("status")
    assert (ended["status"], ended["inserted"], ended["failure"]) == (actions.CANCELED, False, "aborted")
    assert ended["frame"] == "" and planner.asked[1].strategy is Strategy.FUSED
    odd = sdk("act", "--hashes", hashes, "--strategy", "hammer").said("status")
    assert odd["status"] == actions.ABORTED and "'hammer': want one of" in odd["text"] and len(planner.asked) == 2

    with RosNode(endpoint, 0, types, "looking") as node:
        there = {(one.entity, one.name.rsplit("/", 1)[1]) for one in node.graph() if "/_action/" in one.name
                 and one.node == "crosspih"}  # fmt: skip
        assert there == {
            (Entity.SERVICE, "send_goal"), (Entity.SERVICE, "get_result"), (Entity.SERVICE, "cancel_goal"),
            (Entity.PUBLISHER, "feedback"), (Entity.PUBLISHER, "status"),
        }  # fmt: skip
        heard = threading.Event()

        def status(sample: object) -> None:
            message = types.decode(sample.payload, actions.STATUSES)  # type: ignore[attr-defined]
            told.extend(one.status for one in message.status_list)
            heard.set()

        node.subscribe(actions.part("/assemble", "status"), actions.STATUSES, status, RosQos(transient_local=True))
        assert heard.wait(20.0)
    assert told == [actions.SUCCEEDED, actions.CANCELED, actions.ABORTED]
