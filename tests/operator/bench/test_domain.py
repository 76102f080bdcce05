"""The domain's factors are what they say, and the map is drawn."""

from __future__ import annotations

from pathlib import Path

import pytest

from crosspih_common.config import Workcell, load_cell
from services.hardware.config import HardwareConfig
from services.operator.bench.cells.conditions import cell_content
from services.operator.bench.cells.trials import TrialJob
from services.operator.bench.contact_states.plan import lateral_stiffness_n_m
from services.operator.bench.domain.boxes import boxes_of
from services.operator.bench.domain.factors import SIMULATED_DEFAULTS, Factor, factors
from services.operator.bench.domain.heat_map import draw_map
from services.operator.scoring.score import TrialFigures

CELL = load_cell("deploy/cells/default.yaml")
FACTORS = factors(CELL.workcell, CELL.sections["hardware"])


def test_the_defaults_stated_are_the_simulators() -> None:
    simulated = HardwareConfig().simulated.model_dump()
    assert simulated["friction_coefficient"] == SIMULATED_DEFAULTS["friction_coefficient"]
    for name, value in SIMULATED_DEFAULTS["force_torque"].items():
        assert simulated["force_torque"][name] == value


@pytest.mark.parametrize("factor", FACTORS, ids=lambda factor: str(factor.name))
def test_each_factor_has_the_default_once_and_only_valid_levels(factor: Factor) -> None:
    assert sum(level.is_default for level in factor.levels) == 1
    assert len({level.name for level in factor.levels}) == len(factor.levels)
    for level in factor.levels:
        content = cell_content(CELL.text, factor.condition(level))
        workcell = Workcell.model_validate(content["cell"])
        hardware = HardwareConfig.model_validate(content.get("hardware") or {})
        told = workcell != CELL.workcell
        simulated = hardware != CELL.section("hardware", HardwareConfig)
        assert (told, simulated) == (
            (not level.is_default) and factor.known,
            (not level.is_default) and not factor.known,
        )


def test_stiffness_is_of_the_wrist_at_the_rim() -> None:
    (factor,) = (one for one in FACTORS if one.name == "stiffness")
    for level in factor.levels:
        workcell = Workcell.model_validate(cell_content(CELL.text, factor.condition(level))["cell"])
        wanted = float(level.name.split()[0])
        assert lateral_stiffness_n_m(workcell) * 1e-3 == pytest.approx(wanted, rel=0.02)


def _figures(seed: int, inserted: bool) -> TrialFigures:
    return TrialFigures.model_validate(
        {
            "seed": seed, "strategy": "fused", "inserted": inserted, "failure": None if inserted else "overload",
            "failure_detail": "", "backed_off": not inserted, "motion_s": 6.0, "thinking_s": 0.1, "duration_s": 6.1,
            "wall_s": 2.0, "touches": 0, "presses": 4, "corrections": 0, "pushes": 1, "peak_force_n": 8.0,
            "peak_moment_nm": 0.5, "vision_error_mm": 0.1, "vision_error_deg": 0.1, "vision_tilt_deg": 0.1,
            "vision_depth_mm": 0.1, "final_error_mm": None, "final_error_deg": None, "final_depth_mm": None,
            "insertion_depth_mm": 25.0, "recording": None, "report": None,
        }
    )  # fmt: skip


def test_the_default_counts_in_every_row_and_what_is_missing_stays_empty(tmp_path: Path) -> None:
    factor = FACTORS[0]
    default = next(level for level in factor.levels if level.is_default)
    other = next(level for level in factor.levels if not level.is_default)
    done = [
        (TrialJob(seed=seed, condition=factor.condition(level)), _figures(seed, level is default or seed == 1))
        for level in (default, other)
        for seed in (1, 2)
    ]
    boxes = boxes_of(FACTORS, done, 1)
    assert sum(box.is_default for box in boxes) == len(FACTORS)
    for box in boxes:
        if box.is_default:
            assert box.result is not None and box.result.inserted == 2
        elif box.level == other.name:
            assert box.result is not None and box.result.failures == {"overload": 1}
        else:
            assert box.result is None
    path = tmp_path / "map.png"
    draw_map(boxes, "fused", 2, 0.95, path)
    assert path.read_bytes().startswith(b"\x89PNG")
