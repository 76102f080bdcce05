"""A peg that sticks in its bore, in the whole cell: it clamps itself, backs out, is aligned, and goes in."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from crosspih_common.messages import Phase
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.operator.scoring.score import score
from services.planning.config import PlanningConfig
from tests.planning.cell_in_memory import CellInMemory


@pytest.fixture(scope="module")
def rough(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CellInMemory]:
    """Friction 0.3, three times what the drawing has: ends 54 mm apart clamp one another down to 16 mm."""
    pytest.importorskip("pybullet", reason="whether a peg wedges is chance: these seeds do in PyBullet")
    cell = CellInMemory(
        tmp_path_factory.mktemp("rough"), simulated=SimulatedConfig(friction_coefficient=0.3), calibrated=False
    )
    yield cell
    cell.close()


@pytest.mark.parametrize(("seed", "axis"), [(1000, (1.0, 0.0)), (1001, (0.0, 1.0))])
def test_a_wedged_peg_backs_out_and_goes_in(rough: CellInMemory, seed: int, axis: tuple[float, float]) -> None:
    """Vision is 6 degrees off and says 0.2: the taper leads the peg in, and the body's ends wedge in the bore.

    One push more or less, and one touch, is chance: a wedge begins at a hundredth of a millimetre.
    """
    rough.vision_lie = np.array([0.0, 0.0, 0.0, *(np.radians(6.0) * np.array(axis)), 0.0])
    rough.reset(seed)
    result = rough.assemble()
    told = [phase for phase in rough.phases if phase.phase is Phase.PUSHING and phase.text.startswith("wedged")]
    assert told and told[0].text.endswith("back_off")
    assert told[0].figures["back_off_mm"] > told[0].figures["entered_mm"]
    assert told[0].figures["push_force_n"] < PlanningConfig().push_force_n
    assert result.inserted and result.touches <= 1
    figures = score(rough.cell.workcell, result, rough.truth(), wall_s=0.0, recording=None)
    assert figures.inserted and figures.final_error_deg is not None and figures.final_error_deg < 0.3
