"""Identifies the content of a recording that was made for viewers; our own readers skip it."""

from __future__ import annotations

PREFIX = "/foxglove/"
URDF = "arm.urdf"  # the attachment with the arm


def for_viewers(topic: str) -> bool:
    """Whether a channel holds only messages derived from other channels, for viewers."""
    return topic.startswith(PREFIX)
