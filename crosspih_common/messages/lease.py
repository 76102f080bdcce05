"""Who holds the arm: motion needs a holder, one at a time, that shows by its beats that it still lives."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.messages.base import Message


class TakeLease(Message):
    """Hold the arm. Refused with code `held`, naming the holder, while somebody else does."""

    holder: str = Field(min_length=1, max_length=100, description="the service's name")
    purpose: str = Field(default="", max_length=200, description="what the arm is held for, in words for people")


class LeaseGranted(Message):
    """The arm is held. `lease` stands in every motion from now on, and beats keep it."""

    lease: str = Field(min_length=1, description="a random token that only its holder knows")
    holder: str
    timeout_s: float = Field(gt=0.0, description="a holder without a beat for this long counts as lost, wall time")
    beat_s: float = Field(gt=0.0, description="period of the beats, wall time")


class GiveLease(Message):
    """Let go of the arm. What still moves is stopped."""

    lease: str


class LeaseGiven(Message):
    """Whether that lease was the present one until now."""

    was_held: bool


class LeaseBeat(Message):
    """The holder still lives. Those of the arm itself name no lease: see docs/safety.md."""

    lease: str
    holder: str


class LeaseState(Message):
    """Who holds the arm; `holder` is empty when nobody does."""

    holder: str = ""
    purpose: str = ""
    since_ns: int = Field(ge=0, description="cell clock: since when it is so")
    lost_holder: str = Field(default="", description="who held it last, if it was lost and did not give the arm back")
    lost_purpose: str = Field(default="", description="what for")
