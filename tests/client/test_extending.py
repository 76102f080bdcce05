"""Code of one's own in the place of ours: the examples of docs/examples/my_lab, on the real services in memory."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.bus import Bus
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.keys import ASSEMBLE, ESTIMATE, NETWORK, TRUTH
from crosspih_common.messages import (
    Assemble,
    AssemblyResult,
    ContactState,
    EstimateByNetwork,
    EstimatePose,
    Failure,
    PoseData,
    PosePrior,
    SimulationTruth,
    Strategy,
    Touch,
    floats,
    strategy_of,
)
from crosspih_common.messages.assembly import AnyStrategy, OwnStrategy
from crosspih_common.own_code import content_digest
from crosspih_common.recording import Recording
from services.inference.config import InferenceConfig
from services.inference.shell.service import InferenceShell
from services.operator.bench.cells.conditions import Condition
from services.operator.bench.cells.trials import TrialJob, trial_key
from services.operator.bench.compare.command import _rows
from services.operator.bench.compare.comparison import row_name
from services.operator.cli.chosen_strategy import chosen
from services.planning.config import PlanningConfig
from services.planning.strategies.by_name import strategy_named
from tests.planning.cell_in_memory import CellInMemory
from tests.recorder.synthetic import HOLE, SyntheticRecording, at, estimate

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
RING = "my_lab.mine:RingSearch"
FIT, NET = "my_lab.fit:estimate", "my_lab.net:predict"


@pytest.fixture(autouse=True, scope="module")
def examples() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(EXAMPLES))
        yield


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CellInMemory]:
    running = CellInMemory(tmp_path_factory.mktemp("cell"), with_inference=False)
    own = InferenceConfig(estimator=FIT, network=NET)
    inference = InferenceShell(running.context("inference"), own)
    yield running
    inference.close()
    running.close()


def assembled(cell: CellInMemory, strategy: AnyStrategy) -> AssemblyResult:
    cell.phases.clear()
    return cell.bus.call(ASSEMBLE, Assemble(assembly_id="own", strategy=strategy), 300.0)


def test_a_strategy_of_ones_own_searches_and_enters(cell: CellInMemory) -> None:
    """Vision is off by 6.5 mm and does not say so: the first push does not enter, one on the ring does."""
    cell.reset(1)
    cell.vision_lie = np.array([0.0065, 0.0, 0.0, 0.0, 0.0, 0.0])
    result = assembled(cell, strategy_of(RING))
    cell.vision_lie = np.zeros(6)
    assert result.inserted and result.pushes > 1 and result.strategy == RING, result.failure_detail
    assert AssemblyResult.model_validate_json(result.model_dump_json()).strategy == OwnStrategy(RING)


def test_the_cells_limits_hold_for_it_as_for_ours(
    cell: CellInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What cannot be driven to, what is no pose and what raises ends by name, with the peg backed off."""
    (tmp_path / "bad_lab.py").write_text(
        "class Far:\n"
        "    def assemble(self, tools):\n"
        "        from crosspih_common.geometry import Pose\n"
        "        tools.approach(tools.locate().pose_base_hole.pose() @ Pose.from_translation([0.2, 0.0, 0.0]))\n"
        "class Nothing:\n    def assemble(self, tools):\n        tools.locate()\n"
        "class Broken:\n    def assemble(self, tools):\n        return 1 / 0\n"
        "class Lying:\n"
        "    def assemble(self, tools):\n"
        "        from crosspih_common.messages import PosePrior\n"
        "        seen = tools.locate()\n"
        "        return PosePrior(pose_base_hole=seen.pose_base_hole, covariance=seen.covariance)\n"
        "class NoMethod: pass\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    cell.reset(2)
    for name, failure, said in (
        ("Far", Failure.UNREACHABLE, "the hole cannot be at"),
        ("Nothing", Failure.DEFECT, "returned NoneType, want PosePrior"),
        ("Broken", Failure.DEFECT, "ZeroDivisionError"),
        ("Lying", Failure.REFUSED, "not_seated"),
    ):
        result = assembled(cell, strategy_of(f"bad_lab:{name}"))
        assert (result.failure, result.backed_off) == (failure, True) and said in result.failure_detail
    with pytest.raises(CommandRefused, match=r"no_strategy: .*NoMethod has no method assemble\(tools\)"):
        assembled(cell, strategy_of("bad_lab:NoMethod"))


@pytest.mark.parametrize(
    ("name", "allowed", "said"),
    [
        ("nowhere.mine:Own", None, "no module nowhere where the service runs; install it there, or start the stack"),
        ("my_lab.mine:Missing", None, "module my_lab.mine has no Missing"),
        ("fussed", None, "did you mean fused"),
        (RING, ("other:Own",), r"list it in its file, planning.strategies: \[my_lab.mine:RingSearch\]"),
    ],
)
def test_a_strategy_that_cannot_be_had_is_refused_with_the_mend(
    name: str, allowed: tuple[str, ...] | None, said: str
) -> None:
    with pytest.raises(CommandRefused, match=said) as refused:
        strategy_named(strategy_of(name), PlanningConfig(strategies=allowed))
    assert refused.value.code == "no_strategy"


def test_a_cell_with_certificates_loads_what_its_file_lists_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "CROSSPIH_CERTIFICATES", "certificates")
    with pytest.raises(CommandRefused, match="this cell runs none of that name"):
        strategy_named(strategy_of(RING), PlanningConfig())
    assert callable(strategy_named(strategy_of(RING), PlanningConfig(strategies=(RING,))))
    assert callable(strategy_named(Strategy.FUSED, PlanningConfig()))


# -------------------------------------------------------------------------------------------- estimators and networks


def touch(force_x_n: float, moment_y_nm: float = 0.0) -> Touch:
    hole = HOLE @ Pose.from_translation([0.0, 0.0, -0.16])
    return Touch(
        index=0, pose_base_peg=PoseData.of(hole), direction_base=(0.0, 0.0, 1.0), joints_rad=(0.0,) * 6,
        wrench=(force_x_n, 0.0, -5.0, 0.0, moment_y_nm, 0.0), wrench_sd=(0.1,) * 3 + (0.005,) * 3,
        state=ContactState(case="0-0-0", count=0, sense=0, n_z0=0.0, confidence=0.0),
    )  # fmt: skip


def prior() -> PosePrior:
    covariance = floats(np.diag([1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4]))
    return PosePrior(pose_base_hole=PoseData.of(HOLE), covariance=covariance)


def test_an_estimator_and_a_network_of_ones_own_answer_in_our_place(cell: CellInMemory) -> None:
    with Bus(cell.hub.transport(), cell.bus.cell, "planning") as planning:
        found = planning.call(ESTIMATE, EstimatePose(prior=prior(), touches=(touch(4.0),)), 30.0)
        moved = HOLE.inverse() @ found.pose_base_hole.pose()
        # by hand: variance 1e-6 against 0.64e-6, a step of 0.6 mm
        assert moved.translation_m == pytest.approx([0.0006 / 1.64, 0.0, 0.0], abs=1e-9)
        assert found.method == FIT and found.covariance[0] == pytest.approx(1e-6 * 0.64 / 1.64)
        asked = EstimateByNetwork(touch=touch(0.0, 0.5), pose_base_hole_believed=PoseData.of(HOLE))
        turned = planning.call(NETWORK, asked, 30.0)
        assert turned.method == NET
        assert HOLE.angle_to_rad(turned.pose_base_hole.pose()) == pytest.approx(0.03 * 0.5, abs=1e-9)


def test_what_fails_in_it_refuses_the_command_by_its_name(
    cell: CellInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "odd_fit.py").write_text(
        "def estimate(prior, touches, workcell): return None\ndef raising(prior, touches, workcell): return {}['x']\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    from services.inference.shell.own import OwnEstimator

    for name, said in (("odd_fit:estimate", "answered NoneType, want PosePrior"), ("odd_fit:raising", "KeyError")):
        with pytest.raises(CommandRefused, match=said) as refused:
            OwnEstimator(name, cell.cell.workcell)(prior(), [touch(1.0)])
        assert refused.value.code == "own_code"
    with pytest.raises(ConfigError, match=r"inference\.estimator odd_fit:none: module odd_fit has no none"):
        OwnEstimator("odd_fit:none", cell.cell.workcell)


def test_an_estimator_stands_beside_ours_on_the_same_recorded_touches(tmp_path: Path) -> None:
    from my_lab.beside_ours import errors_mm  # type: ignore[import-not-found]

    made = SyntheticRecording(tmp_path / "a.mcap")
    truth = SimulationTruth(
        stamp_ns=at(-1.0), seed=1, pose_base_hole=PoseData.of(HOLE), pose_base_peg=PoseData.of(HOLE),
        wrench_contact=(0.0,) * 6,
    )  # fmt: skip
    made.add(TRUTH, truth)
    made.add(ESTIMATE.request_echo, EstimatePose(stamp_ns=at(1.0), prior=prior(), touches=(touch(4.0),)))
    made.add(ESTIMATE.reply_echo, estimate(1.1, 0.0002, 1))
    made.finish()
    rows = errors_mm(Recording(tmp_path / "a.mcap"), Workcell())
    ((count, ours_mm, own_mm),) = rows
    assert count == 1 and (ours_mm, own_mm) == pytest.approx((0.2, 0.6 / 1.64))


# ------------------------------------------------------------------------------------------------------------- benches


def test_benches_name_their_rows_and_measure_an_edited_file_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = Condition(name="good vision")
    rows = _rows([Strategy.PAPER, Strategy.FUSED, strategy_of(RING)], plain, {"estimator": [FIT], "network": [NET]})
    names = [row_name(TrialJob(seed=1, strategy=one, condition=condition)) for one, condition in rows]
    assert names == [
        "paper", f"paper with {NET}", "fused", f"fused with {FIT}", RING, f"{RING} with {FIT}", f"{RING} with {NET}",
    ]  # fmt: skip
    file = tmp_path / "edited_lab.py"
    monkeypatch.syspath_prepend(str(tmp_path))
    job = TrialJob(seed=1, strategy=strategy_of("edited_lab:Own"))
    keys = []
    for text in ("class Own: pass\n", "class Own: x = 1\n"):
        file.write_text(text)
        keys.append(trial_key({}, job, "code"))
        keys.append(trial_key({"inference": {"network": "edited_lab:f"}}, TrialJob(seed=1), "code"))
    assert len(set(keys)) == 4 and "edited_lab" not in sys.modules
    with pytest.raises(ConfigError, match="no module gone_lab here; put its folder in PYTHONPATH"):
        content_digest("strategy", "gone_lab:Own")


def test_a_misspelt_strategy_is_told_before_anything_starts() -> None:
    assert chosen("fused") is Strategy.FUSED and chosen(RING) == RING
    for name, said in (
        ("fussed", "did you mean fused"),
        ("a b", "want fused, force_alone"),
        ("zz", "your own as module"),
    ):
        with pytest.raises(ConfigError, match=said):
            chosen(name)
