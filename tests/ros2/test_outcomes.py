"""What ROS is told of an assembly that has no result."""

from __future__ import annotations

import pytest

from crosspih_common.errors import STOPPING, CommandRefused, CommandTimeout, CrosspihError, NoService, NotSent
from crosspih_common.messages import Failure
from services.ros2.outcomes import error_outcome


@pytest.mark.parametrize(
    ("error", "failure", "said"),
    [
        (NotSent("planning/assemble: nobody answers"), "no_service", "nobody answers; nothing was begun"),
        (NoService("planning/assemble: nobody answers"), Failure.SERVICE_LOST.value, "the peg may be in the hole"),
        (CommandRefused(STOPPING, "planning was stopped"), Failure.SERVICE_LOST.value, "planning was stopped"),
        (CommandRefused("held", "by the teach pendant"), Failure.REFUSED.value, "held: by the teach pendant"),
        (CommandTimeout("no answer within 900 s"), "command_timeout", "no answer within 900 s"),
    ],
)
def test_an_assembly_without_a_result_has_a_name(error: CrosspihError, failure: str, said: str) -> None:
    name, text = error_outcome(error)
    assert name == failure and said in text
