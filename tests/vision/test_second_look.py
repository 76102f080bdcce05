"""A refused picture is taken again under another light, over the bus, with the real cameras and the real service."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import LOCATE, RESET
from crosspih_common.messages import HoleEstimate, LocateHole, ResetCell, SceneFaults
from crosspih_common.service.lifecycle import ServiceContext, ServiceResource
from services.hardware.config import HardwareConfig
from services.hardware.hosting import open_cell
from services.hardware.shells.hardware import HardwareShell
from services.vision.config import VisionConfig
from services.vision.second_look import LAMPS, Lighting, next_look
from services.vision.shell import VisionShell
from tests.vision.pictures.plain_look import PLAIN_CAMERA


def test_light_is_changed_towards_what_was_refused() -> None:
    assert next_look(Lighting(), "too_dark") == Lighting(exposure_scale=4.0)
    brighter = next_look(Lighting(), "too_bright")
    assert brighter is not None and 0.0 < brighter.exposure_scale < 1.0
    assert next_look(Lighting(2.0), "poor_fit") == Lighting(2.0, lamp=1)


@pytest.mark.parametrize("code", ["wrong_image", "cut_off", "two_crosses", "outside_prior"])
def test_no_light_is_tried_where_light_is_not_what_is_wrong(code: str) -> None:
    assert next_look(Lighting(), code) is None


@pytest.mark.parametrize("code", ["too_dark", "too_bright", "no_cross", "not_enough_rim"])
def test_trying_ends(code: str) -> None:
    look: Lighting | None = Lighting()
    for _ in range(4 * LAMPS):
        if look is None:
            return
        look = next_look(look, code)
    pytest.fail("still trying")


class Cell:
    """Cameras and vision on an in-memory bus."""

    def __init__(self, looks: int) -> None:
        self.hub, cell = MemoryHub(), load_cell("deploy/cells/default.yaml")

        def context(service: str) -> ServiceContext:
            return ServiceContext(service, cell, Bus(self.hub.transport(), cell.workcell.name, service))

        plain = HardwareConfig.model_validate({"simulated": {"camera": PLAIN_CAMERA}})
        self.contexts = [context(name) for name in ("hardware", "vision", "operator")]
        self.shells: list[ServiceResource] = [
            HardwareShell(open_cell(cell.workcell, plain, False), self.contexts[0]),
            VisionShell(self.contexts[1], VisionConfig(looks=looks)),
        ]
        self.bus = self.contexts[2].bus

    def see(self, scene: SceneFaults) -> tuple[HoleEstimate, float]:
        """The estimate, and its distance across from the true hole, m."""
        truth = self.bus.call(RESET, ResetCell(seed=5, scene=scene), 30.0)
        seen = self.bus.call(LOCATE, LocateHole(), 60.0)
        off = truth.pose_base_hole.pose().inverse() @ seen.pose_base_hole.pose()
        return seen, float(np.hypot(*off.translation_m[:2]))

    def close(self) -> None:
        for shell in self.shells:
            shell.close()
        for context in self.contexts:
            context.bus.close()


@pytest.fixture(scope="module")
def three_looks() -> Iterator[Cell]:
    cell = Cell(3)
    yield cell
    cell.close()


def test_a_dark_cell_is_seen_with_a_longer_exposure(three_looks: Cell) -> None:
    seen, off_m = three_looks.see(SceneFaults(light_scale=0.1))
    assert seen.diagnostics["looks"] > 1 and seen.diagnostics["exposure_scale"] > 1.0
    assert off_m < 0.3e-3


def test_a_glaring_cell_is_seen_with_as_many_lamps_as_it_takes(three_looks: Cell) -> None:
    seen, off_m = three_looks.see(SceneFaults(glare=150.0))
    assert seen.diagnostics["lamp"] == seen.diagnostics["looks"] - 1.0
    assert off_m < 0.3e-3


def test_a_saturated_picture_is_seen_with_a_shorter_exposure(three_looks: Cell) -> None:
    seen, off_m = three_looks.see(SceneFaults(light_scale=3.0))
    assert seen.diagnostics["exposure_scale"] < 1.0
    assert off_m < 0.3e-3


def test_a_blank_plate_is_refused_under_every_light_and_says_so(three_looks: Cell) -> None:
    with pytest.raises(CommandRefused, match=r"2 more under other light: no_cross, no_cross"):
        three_looks.see(SceneFaults(hole=False))


def test_one_look_is_believed_when_the_cell_says_so() -> None:
    cell = Cell(1)
    try:
        with pytest.raises(CommandRefused) as refused:
            cell.see(SceneFaults(light_scale=0.1))
        assert refused.value.code == "too_dark"
    finally:
        cell.close()
