"""`assemble` as a ROS 2 action: the same assembly as by the service, with feedback and a result, and cancellable.

One goal at a time, and none during an assembly or withdrawal by the services: such a goal is rejected, not queued.
Planning aborts a cancelled goal like any assembly: the peg is backed off before the goal ends.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.bus import Bus
from crosspih_common.bus.workers import Lane
from crosspih_common.errors import CrosspihError
from crosspih_common.geometry import Pose
from crosspih_common.keys import ABORT, ASSEMBLE, PHASE
from crosspih_common.messages import (
    AbortAssembly,
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    Failure,
    PoseData,
    Strategy,
)
from crosspih_common.ros2 import RosNode, RosQos
from crosspih_common.ros2 import actions as ros
from crosspih_common.ros2.converting import SECOND_NS, Converter
from services.ros2.outcomes import ABORT_DEADLINE_S, ASSEMBLY_DEADLINE_S, assembly_outcome, error_outcome

NAME = "crosspih_interfaces/action/Assemble"
DEFINITION = Path(__file__).parent / "crosspih_interfaces" / "action" / "Assemble.action"
KEPT = 8  # ended goals whose results can still be requested
FEEDBACK, STATUS = RosQos(depth=10), RosQos(transient_local=True, depth=1)  # the QoS profiles of rcl_action
Reply = Callable[[Any], None]


@dataclass(eq=False)
class _Goal:
    """One goal; `stamp_ns` is the time of its acceptance, by the wall clock."""

    id: bytes
    stamp_ns: int
    status: int = ros.ACCEPTED
    result: Any = None
    waiting: list[Reply] = field(default_factory=list)

    @property
    def active(self) -> bool:
        return self.status in (ros.ACCEPTED, ros.EXECUTING, ros.CANCELING)

    @property
    def assembly_id(self) -> str:
        return f"ros2-{self.id.hex()[:8]}"


class AssembleAction:
    """The action `assemble` of the bridge's node; `motions` is the lane on which its services run their motions."""

    def __init__(self, node: RosNode, bus: Bus, motions: Lane, strategy: Strategy, base_frame: str) -> None:
        self._types, self._bus, self._motions, self._strategy = node.types, bus, motions, strategy
        self._base_frame = base_frame
        ros.add_action(node.types, NAME, DEFINITION.read_text(encoding="utf-8"))
        self._convert = Converter(node.types)
        self._lock = threading.Lock()
        self._goals: dict[bytes, _Goal] = {}
        self._asked = Lane("ros2:goals")
        self._feedback = node.publisher(ros.part("assemble", "feedback"), f"{NAME}_FeedbackMessage", FEEDBACK)
        self._status = node.publisher(ros.part("assemble", "status"), ros.STATUSES, STATUS)
        node.serve(ros.part("assemble", "send_goal"), f"{NAME}_SendGoal", self._send_goal, lane=self._asked)
        node.serve(ros.part("assemble", "cancel_goal"), ros.CANCEL, self._cancel, lane=self._asked)
        node.serve_later(ros.part("assemble", "get_result"), f"{NAME}_GetResult", self._get_result)
        bus.subscribe(PHASE, self._phase)
        self._tell_status()

    def _send_goal(self, payload: bytes) -> Any:
        request = self._types.decode(payload, f"{NAME}_SendGoal_Request")
        goal = _Goal(bytes(request.goal_id.uuid), time.time_ns())
        with self._lock:
            accepted = goal.id not in self._goals
            if accepted:
                self._goals[goal.id] = goal
        strategy = str(request.goal.strategy)
        if accepted and not self._motions.offer(lambda: self._carry_out(goal, strategy), only_when_idle=True):
            accepted = False
            with self._lock:
                del self._goals[goal.id]
        if accepted:
            self._tell_status()
        return self._types.make(f"{NAME}_SendGoal_Response", accepted=accepted, stamp=self._convert.time(goal.stamp_ns))

    def _carry_out(self, goal: _Goal, strategy: str) -> Callable[[], None]:
        """Runs on the lane of motions; the returned function is called when the lane counts as idle again."""
        with self._lock:
            goal.status = ros.EXECUTING
        self._tell_status()
        try:
            status, message = self._outcome(goal, strategy)
        except Exception as error:
            # a bug must be reported to the client, and must not leave the goal without an end
            status, message = ros.ABORTED, self._ended(Failure.DEFECT.value, f"{type(error).__name__}: {error}")
        return lambda: self._finish(goal, status, message)

    def _outcome(self, goal: _Goal, strategy: str) -> tuple[int, Any]:
        """Request the assembly: returns the goal's final status and its result."""
        try:
            wanted = Strategy(strategy) if strategy else self._strategy
        except ValueError:
            text = f"strategy {strategy!r}: want one of {', '.join(one.value for one in Strategy)}, or nothing"
            return ros.ABORTED, self._ended(Failure.REFUSED.value, text)
        try:
            request = Assemble(strategy=wanted, assembly_id=goal.assembly_id)
            result = self._bus.call(ASSEMBLE, request, ASSEMBLY_DEADLINE_S)
        except CrosspihError as error:
            return ros.ABORTED, self._ended(*error_outcome(error))
        if result.inserted:
            return ros.SUCCEEDED, self._message(result)
        cancelled = result.failure is Failure.ABORTED and goal.status == ros.CANCELING
        return ros.CANCELED if cancelled else ros.ABORTED, self._message(result)

    def _finish(self, goal: _Goal, status: int, message: Any) -> None:
        with self._lock:
            goal.status, goal.result = status, message
            waiting, goal.waiting = goal.waiting, []
            ended = [one for one in self._goals.values() if not one.active]
            for old in ended[:-KEPT]:
                del self._goals[old.id]
        self._tell_status()
        for reply in waiting:
            reply(self._answer(status, message))

    def _get_result(self, payload: bytes, reply: Reply) -> None:
        """On Zenoh's thread: answered at once if the goal has ended or is unknown, else when it ends."""

        def look() -> Callable[[], None]:
            goal_id = bytes(self._types.decode(payload, f"{NAME}_GetResult_Request").goal_id.uuid)
            with self._lock:
                goal = self._goals.get(goal_id)
                if goal is not None and goal.active:
                    goal.waiting.append(reply)
                    return lambda: None
            if goal is None:
                answer = self._answer(ros.UNKNOWN, self._ended(Failure.REFUSED.value, "no such goal, or long ago"))
            else:
                answer = self._answer(goal.status, goal.result)
            return lambda: reply(answer)

        self._asked.offer(look)

    def _cancel(self, payload: bytes) -> Any:
        """action_msgs/CancelGoal: one goal, all up to a stamp, or all."""
        info = self._types.decode(payload, f"{ros.CANCEL}_Request").goal_info
        goal_id, until_ns = bytes(info.goal_id.uuid), info.stamp.sec * SECOND_NS + info.stamp.nanosec
        everyone = not any(goal_id) and not until_ns
        with self._lock:
            known = goal_id in self._goals
            chosen = [
                goal
                for goal in self._goals.values()
                if goal.active and (everyone or goal.id == goal_id or goal.stamp_ns <= until_ns)
            ]
            before = [goal.status for goal in chosen]
            for goal in chosen:
                goal.status = ros.CANCELING  # before planning is informed: the goal may end at once
        if not chosen:
            lost = ros.CANCEL_GOAL_TERMINATED if known else ros.CANCEL_UNKNOWN_GOAL
            return self._cancelled(lost if any(goal_id) else ros.CANCEL_NONE, [])
        try:
            heard = self._bus.call(ABORT, AbortAssembly(), ABORT_DEADLINE_S).was_running
        except CrosspihError:
            heard = False
        if not heard:  # planning has not started it yet, or has finished
            with self._lock:
                for goal, status in zip(chosen, before, strict=True):
                    goal.status = status if goal.status == ros.CANCELING else goal.status
            return self._cancelled(ros.CANCEL_REJECTED, [])
        self._tell_status()
        return self._cancelled(ros.CANCEL_NONE, chosen)

    def _phase(self, phase: AssemblyPhase) -> None:
        with self._lock:
            goals = [one for one in self._goals.values() if one.active and one.assembly_id == phase.assembly_id]
        for goal in goals:
            said = self._types.make(f"{NAME}_Feedback", phase=phase.phase.value, text=phase.text)
            self._feedback.publish(
                self._types.make(f"{NAME}_FeedbackMessage", goal_id=self._uuid(goal.id), feedback=said)
            )

    def _tell_status(self) -> None:
        with self._lock:
            told = [
                self._types.make(ros.STATUS, goal_info=self._info(goal), status=goal.status)
                for goal in self._goals.values()
            ]
            self._status.publish(self._types.make(ros.STATUSES, status_list=told))

    def _uuid(self, goal_id: bytes) -> Any:
        return self._types.make(ros.UUID, uuid=np.frombuffer(goal_id, dtype=np.uint8))

    def _info(self, goal: _Goal) -> Any:
        stamp = self._convert.time(goal.stamp_ns)
        return self._types.make(ros.GOAL_INFO, goal_id=self._uuid(goal.id), stamp=stamp)

    def _cancelled(self, code: int, goals: list[_Goal]) -> Any:
        infos = [self._info(goal) for goal in goals]
        return self._types.make(f"{ros.CANCEL}_Response", return_code=code, goals_canceling=infos)

    def _answer(self, status: int, result: Any) -> Any:
        return self._types.make(f"{NAME}_GetResult_Response", status=status, result=result)

    def _message(self, result: AssemblyResult) -> Any:
        return self._ended(
            "" if result.failure is None else result.failure.value, assembly_outcome(result)[1],
            inserted=result.inserted, pose_base_hole=result.pose_base_hole, pose_base_peg=result.pose_base_peg,
            insertion_depth_m=result.insertion_depth_m, duration_s=result.motion_s + result.thinking_s,
            peak_force_n=result.peak_force_n,
        )  # fmt: skip

    def _ended(
        self, failure: str, text: str, *, inserted: bool = False, pose_base_hole: PoseData | None = None,
        pose_base_peg: PoseData | None = None, insertion_depth_m: float = 0.0, duration_s: float = 0.0,
        peak_force_n: float = 0.0,
    ) -> Any:  # fmt: skip
        return self._types.make(
            f"{NAME}_Result", inserted=inserted, failure=failure, text=text,
            pose_base_hole=self._posed(pose_base_hole), pose_base_peg=self._posed(pose_base_peg),
            insertion_depth_m=insertion_depth_m, duration_s=duration_s, peak_force_n=peak_force_n,
        )  # fmt: skip

    def _posed(self, pose: PoseData | None) -> Any:
        if pose is None:
            return self._convert.pose_stamped(Pose.from_translation([0.0, 0.0, 0.0]), "", time.time_ns())
        return self._convert.pose_stamped(pose.pose(), self._base_frame, time.time_ns())

    def close(self) -> None:
        """Accept no further goals."""
        self._asked.close()
