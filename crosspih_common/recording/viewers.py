"""What in a recording was made for viewers, from messages that are in it themselves: not for our own readers."""

from __future__ import annotations

PREFIX = "/foxglove/"
URDF = "arm.urdf"  # the attachment with the arm


def for_viewers(topic: str) -> bool:
    """Whether a channel's messages follow from those of others."""
    return topic.startswith(PREFIX)
