"""The commands of the README on a cell that has no simulator: no reset, no truth, and nothing said that needs them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from services.operator.assembly.session import Session
from tests.system.running_cell import RunningCell

BARE = "hardware:\n  driver: tests.system.bare_driver:open_devices\n"
OF_THE_TRUTH = ("vision_error_mm", "vision_error_deg", "final_error_mm", "final_error_deg", "challenge_score", "seed")


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningCell]:
    """The whole stack on the bare driver."""
    with pytest.MonkeyPatch.context() as environment:
        running = RunningCell(tmp_path_factory.mktemp("bare"), "bare", environment, more=BARE)
        running.start()
        try:
            yield running
        finally:
            running.stop()


def test_the_sensor_is_calibrated(bare: RunningCell) -> None:
    done = bare.cli("calibrate", "ft")
    assert done.returncode == 0, done.stderr
    assert "weight" in done.stdout


def test_assemble_report_and_withdraw(bare: RunningCell) -> None:
    done = bare.cli("assemble", "--json")
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["inserted"] and not [name for name in OF_THE_TRUTH if figures[name] is not None]
    assert figures["insertion_depth_mm"] > 20.0 and figures["found"] is not None
    assert "no simulator" in done.stderr
    page = Path(figures["report"]).read_text(encoding="utf-8")
    assert "without a simulator nothing tells" in page
    assert "as it is (truth)" not in page
    out = bare.cli("withdraw", "--json")
    assert out.returncode == 0, out.stderr
    assert json.loads(out.stdout)["withdrawn"]
    with Session() as session:
        session.wait_for_services(30.0)
        assert not session.simulated and session.truth() is None


def test_the_running_bench_repeats_the_same_hole(bare: RunningCell) -> None:
    done = bare.cli("bench", "assembly", "--running", "--trials", "2", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["inserted"] == result["trials"] == 2
    assert "final_error_mm" not in result["figures"] and "peak_force_n" in result["figures"]
    spread = result["repeatability"]
    assert spread["count"] == 2
    assert 0.0 < spread["sd_lateral_mm"] < 0.1 and spread["largest_rotation_deg"] < 0.5
