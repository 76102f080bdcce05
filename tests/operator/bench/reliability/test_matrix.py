"""The matrix of deaths: every case once, what counts as a loss, and the section of the page."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from crosspih_common.errors import ConfigError
from crosspih_common.messages import Phase, Strategy
from crosspih_common.provenance import ResultStore
from services.operator.bench.reliability.matrix.command import case_key
from services.operator.bench.reliability.matrix.judging import MatrixObservation, TapeFigures, complaints, lost, outcome
from services.operator.bench.reliability.matrix.page import BEGIN, END, MatrixResult, section, write_section
from services.operator.bench.reliability.matrix.plan import PHASES, VICTIMS, MatrixCase, ProcessEnding, cases
from services.operator.cli.commands import app

TAPE = TapeFigures(parts=1, gap_s=0.05, missing=0, finished=True)
INSERTED = MatrixObservation(
    signalled=True, result_s=20.0, inserted=True, status=0, healthy_s=2.0, tape=TAPE, tip_before_m=-0.05
)


def case(
    victim: str = "planning", ending: ProcessEnding = ProcessEnding.KILL, phase: Phase = Phase.PUSHING
) -> MatrixCase:
    return MatrixCase(victim=victim, phase=phase, ending=ending, seed=1)


def test_every_process_by_every_signal_in_every_phase_once() -> None:
    every = list(cases(VICTIMS, PHASES, ProcessEnding, 1000))
    assert len(every) == len({one.name for one in every}) == 8 * 5 * 3
    assert {"router", "operator", "recorder", "hardware"} < {one.victim for one in every}
    touching = {one.moment.strategy for one in every if one.phase is Phase.TOUCHING}
    assert touching == {Strategy.FORCE_ALONE}


def test_an_insertion_that_lost_nothing_holds() -> None:
    assert complaints(case(), INSERTED) == []
    assert (outcome(case(), INSERTED), lost(INSERTED)) == ("inserted", "nothing")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"result_s": None}, "nobody was told"),
        ({"inserted": False, "tip_before_m": None}, "no name"),
        ({"inserted": False, "failure": "service_lost", "backed_off": True}, "still 50 mm in the hole"),
        ({"healthy_s": None}, "not healthy again"),
        ({"tape": None}, "no recording"),
        ({"tape": TAPE.model_copy(update={"missing": 7})}, "nothing says so"),
    ],
)
def test_each_loss_is_told(change: dict[str, object], said: str) -> None:
    found = complaints(case(), INSERTED.model_copy(update=change))
    assert len(found) == 1 and said in found[0]


def test_a_time_without_samples_is_a_loss_where_the_recorder_was_away() -> None:
    """Samples of the others that come late come whole: their numbers tell."""
    silent = INSERTED.model_copy(update={"tape": TAPE.model_copy(update={"gap_s": 3.0})})
    assert complaints(case("vision"), silent) == []
    assert len(complaints(case("recorder"), silent)) == 1


def test_what_is_said_is_no_loss_in_silence() -> None:
    parts = TapeFigures(parts=2, gap_s=3.0, missing=0, finished=True, warnings=("2.9 s are missing",))
    seen = INSERTED.model_copy(update={"tape": parts})
    assert complaints(case("recorder"), seen) == [] and lost(seen) == "2 parts, 3.0 s"


def test_nobody_is_told_where_the_operator_is_gone() -> None:
    seen = INSERTED.model_copy(update={"healthy_s": None, "status": -9})
    assert complaints(case("operator"), seen) == []
    assert outcome(case("operator"), seen).startswith("the planner went on")


def test_the_section_is_put_between_the_marks_and_the_rest_is_left(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nformer\n{END}\nafter\n")
    rows = [MatrixResult(case=case(), seen=INSERTED)]
    write_section(page, section(rows, "crosspih bench matrix", 120))
    text = page.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "former" not in text
    assert "1 of 1 cases hold; 120 are planned" in text
    assert "| planning | SIGKILL | pushing | inserted | 20.0 | 2.0 | nothing | yes |" in text
    page.write_text("no marks")
    with pytest.raises(ConfigError, match="--page"):
        write_section(page, "")


def test_what_is_in_the_store_is_not_done_again_and_the_page_is_made_of_it(tmp_path: Path) -> None:
    one = case("router")
    with ResultStore(tmp_path / "rows.jsonl") as store:
        store.put(case_key(one, "realtime"), INSERTED.model_dump(mode="json"))
    page = tmp_path / "page.md"
    page.write_text(f"{BEGIN}\n{END}\n")
    words = ["bench", "matrix", "--victim", "router", "--phase", "pushing", "--signal", "SIGKILL", "--seed", "1"]
    done = CliRunner().invoke(app, [*words, "--store", str(tmp_path / "rows.jsonl"), "--page", str(page)])
    assert done.exit_code == 0, done.output
    assert "1 of 1 taken over from before" in done.stderr and "1 of 1 cases hold" in done.stderr
    assert "| router | SIGKILL | pushing | inserted | 20.0 | 2.0 | nothing | yes |" in page.read_text()
