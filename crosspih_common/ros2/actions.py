"""The parts of a ROS 2 action: three services, two topics, and the types that rosidl derives from its definition.

Source: design.ros2.org, "Actions", and rosidl_parser/definition.py of ROS 2 (class Action).
"""

from __future__ import annotations

from typing import Any

from crosspih_common.ros2.types import RosTypes

UUID, TIME, GOAL_INFO = "unique_identifier_msgs/msg/UUID", "builtin_interfaces/msg/Time", "action_msgs/msg/GoalInfo"
STATUS, STATUSES = "action_msgs/msg/GoalStatus", "action_msgs/msg/GoalStatusArray"
CANCEL = "action_msgs/srv/CancelGoal"
# action_msgs/GoalStatus
UNKNOWN, ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(7)
# action_msgs/CancelGoal
CANCEL_NONE, CANCEL_REJECTED, CANCEL_UNKNOWN_GOAL, CANCEL_GOAL_TERMINATED = range(4)


def add_action(types: RosTypes, name: str, definition: str) -> None:
    """The action `package/action/Name` by the text of its file: goal, result and feedback, `---` between them.

    Adds `CANCEL` too, which all actions share. Raises ValueError where the text has no three parts.
    """
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import get_types_from_msg

    parts = definition.split("\n---\n")
    if len(parts) != 3:
        raise ValueError(f"{name}: {len(parts)} parts, want goal, result and feedback with --- between them")

    def named(kind: str) -> Any:
        return (Nodetype.NAME, kind)

    def basic(kind: str) -> Any:
        return (Nodetype.BASE, (kind, 0))

    for part, kind in zip(parts, ("Goal", "Result", "Feedback"), strict=True):
        types.store.register(get_types_from_msg(part, f"{name}_{kind}"))
    types.register(
        {
            f"{name}_SendGoal_Request": [("goal_id", named(UUID)), ("goal", named(f"{name}_Goal"))],
            f"{name}_SendGoal_Response": [("accepted", basic("bool")), ("stamp", named(TIME))],
            f"{name}_GetResult_Request": [("goal_id", named(UUID))],
            f"{name}_GetResult_Response": [("status", basic("int8")), ("result", named(f"{name}_Result"))],
            f"{name}_FeedbackMessage": [("goal_id", named(UUID)), ("feedback", named(f"{name}_Feedback"))],
            f"{CANCEL}_Request": [("goal_info", named(GOAL_INFO))],
            f"{CANCEL}_Response": [
                ("return_code", basic("int8")),
                ("goals_canceling", (Nodetype.SEQUENCE, (named(GOAL_INFO), 0))),
            ],
        }
    )
    for service in (f"{name}_SendGoal", f"{name}_GetResult", CANCEL):
        types.describe_service(service)


def part(action: str, what: str) -> str:
    """The name of an action's service (`send_goal`, `get_result`, `cancel_goal`) or topic (`feedback`, `status`)."""
    return f"{action}/_action/{what}"
