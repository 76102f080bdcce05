"""How much a publisher holds for readers that miss something: pictures are too large to be held as states are."""

from __future__ import annotations

from typing import Any

import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.bus.bus import PICTURES_KEPT
from crosspih_common.bus.memory import MemoryTransport
from crosspih_common.bus.transport import Sender
from crosspih_common.keys import ANNOTATED_LEFT, CAMERA_CALIBRATION, IMAGE_LEFT, JOINT_STATE, Topic


class Asked(MemoryTransport):
    """Notes how many samples each publisher is asked to hold."""

    def __init__(self, hub: MemoryHub) -> None:
        super().__init__(hub)
        self.history: dict[str, int] = {}

    def sender(self, key: str, *, recover: bool, history: int) -> Sender:
        self.history[key] = history
        return super().sender(key, recover=recover, history=history)


@pytest.mark.parametrize(
    ("topic", "kept"),
    [(IMAGE_LEFT, PICTURES_KEPT), (ANNOTATED_LEFT, PICTURES_KEPT), (CAMERA_CALIBRATION, 64), (JOINT_STATE, 0)],
)
def test_what_a_publisher_holds(topic: Topic[Any], kept: int) -> None:
    transport = Asked(MemoryHub())
    with Bus(transport, "c", topic.publisher) as bus:
        bus.publisher(topic)
    assert transport.history == {topic.key("c"): kept}
