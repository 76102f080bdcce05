"""Contacts collected in the real cell, gone on with after a stop, and made by the mechanics; a training and its
page."""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from crosspih_common.datasets import read_contacts
from services.operator.assembly.payload import ready_arm
from services.operator.assembly.session import Session
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.worker import Outcome
from services.operator.cli.commands import app
from services.operator.dataset.contact import REPEAT_STRIDE, make_contact
from services.operator.other_services.inference_process import ToolFailed, run_tool
from services.operator.training.page import render_training
from tests.planning.cell_in_memory import CellInMemory


class MemorySession(Session):
    """The operator's place on the bus of a cell in memory."""

    def __init__(self, cell: CellInMemory) -> None:
        self.file, self.bus = cell.cell, cell.bus


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    cell = CellInMemory(tmp_path_factory.mktemp("cell"), with_inference=False)
    yield MemorySession(cell)
    cell.close()


class OneCell:
    """An executor whose only cell is in this process; it does `most` tasks and is then stopped."""

    cells = 1

    def __init__(self, session: Session, most: int) -> None:
        self.session, self.left = session, most
        self.outcomes: list[tuple[int, Outcome]] = []

    def submit(self, cell: int, task: CellTask) -> None:
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        self.outcomes.append((cell, Outcome(task.work(self.session, task.payload))))

    def wait(self, busy: list[int], timeout_s: float) -> list[tuple[int, Outcome]]:
        outcomes, self.outcomes = self.outcomes, []
        return outcomes

    def close(self) -> None:
        return


def test_a_contact_is_felt_as_its_pose_error_says_and_repeats(session: Session) -> None:
    with ready_arm(session, "a test") as lease:
        rows = [make_contact(session, lease, 5, repeat, 0.1, 0.001, 15.0) for repeat in (0, 1)]
        other = make_contact(session, lease, 6, 0, 0.1, 0.001, 15.0)
        again = make_contact(session, lease, 5, 0, 0.1, 0.001, 15.0)
    assert again == rows[0] and rows[0].outcome == rows[1].outcome == "contact"
    # a repeat has the pose in common and the noise not
    assert rows[0].angles_rad == rows[1].angles_rad != other.angles_rad and rows[0].wrench != rows[1].wrench
    assert (rows[1].seed, rows[1].pose_seed) == (5 + REPEAT_STRIDE, 5)
    first, second = (np.asarray(row.wrench) for row in rows)
    assert np.abs(first - second)[:3].max() < 0.5 and 13.0 < np.linalg.norm(first[:3]) < 20.0
    assert np.abs(rows[0].translation_m or ())[:2].max() < 0.015


def test_a_stopped_collection_goes_on(session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    most = [1]
    # the package has a function of the same name
    collecting = importlib.import_module("services.operator.dataset.commands.collect")
    monkeypatch.setattr(collecting, "SAMPLES_A_TASK", 1)
    monkeypatch.setattr(collecting, "open_executor", lambda *arguments: OneCell(session, most[0]))
    command = ["dataset", "collect", "--poses", "2", "--seed", "20", "--out", str(tmp_path / "set")]
    stopped = CliRunner().invoke(app, command)
    assert stopped.exit_code == 130, stopped.output
    assert read_contacts(tmp_path / "set").integers("seed").tolist() == [20]
    # one is left, and a cell that may do no more is asked for one
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    table = read_contacts(tmp_path / "set")
    assert table.integers("seed").tolist() == [20, 21] and table.origin.made_by == "cell"
    assert "2 at 2 poses" in done.output
    other = CliRunner().invoke(app, [*command, "--angle-rad", "0.05"])
    assert other.exit_code == 1 and "name another folder" in " ".join(other.output.split())
    most[0] = 2
    moved = CliRunner().invoke(app, [*command, "--angle-rad", "0.05", "--move-aside"])
    assert moved.exit_code == 0 and "moved to" in moved.output, moved.output
    assert read_contacts(tmp_path / "set-before-1").integers("seed").tolist() == [20, 21]
    assert read_contacts(tmp_path / "set").origin.settings["angle_rad"] == 0.05
    shown = CliRunner().invoke(app, ["dataset", "show", str(tmp_path / "set"), "--columns"])
    assert shown.exit_code == 0 and "alpha, beta, gamma" in " ".join(shown.output.split())


def test_contacts_are_made_gone_on_with_and_trained_on(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="set-up left torch out")
    folder, page = tmp_path / "made", tmp_path / "page.html"
    for poses in (60, 130):
        made = CliRunner().invoke(app, ["dataset", "synthesise", "--poses", str(poses), "--out", str(folder)])
        assert made.exit_code == 0, made.output
    whole = read_contacts(folder)
    assert len(whole) == 130 and len(whole.touched()) == 130
    weights = tmp_path / "network.safetensors"
    trained = CliRunner().invoke(
        app,
        ["train", "--data", str(folder), "--weights", str(weights), "--report", str(page), "--optimiser", "lm",
         "--hidden", "8", "--epochs", "5", "--goal", "0", "--floor-contacts", "0"],
    )  # fmt: skip
    assert trained.exit_code == 0, trained.output
    assert whole.sha256() in page.read_text(encoding="utf-8") and b"crosspih train --data" in weights.read_bytes()
    assert whole.sha256().encode() in weights.read_bytes()
    assert "validation" in trained.output
    # five epochs of a gradient that takes a thousand: no better than the mean, which is said
    poor = CliRunner().invoke(
        app,
        ["train", "--data", str(folder), "--weights", str(weights), "--report", str(page), "--optimiser", "traingdx",
         "--epochs", "1", "--goal", "0", "--floor-contacts", "0"],
    )  # fmt: skip
    said = "no better than guessing the mean in"
    assert poor.exit_code == 0 and said in " ".join(poor.output.split()) and said in page.read_text(encoding="utf-8")


def result_of_a_training(rows: bool) -> dict[str, object]:
    """As the training process says it."""
    rng = np.random.default_rng(0)
    figures = {"rms_deg": [1.0, 2.0, 3.0], "p95_deg": [2.0, 3.0, 4.0], "max_deg": [3.0, 4.0, 5.0],
               "within_1_deg": [0.5, 0.2, 0.1]}  # fmt: skip
    values = rng.normal(size=(10, 3)).tolist()
    common = {
        "hidden": 150, "optimiser": "traingdx", "doubts": ["no epoch helped"],
        "record": {"seed": 1, "command": "crosspih <train>", "epochs": 3, "goal": 1e-3, "dataset_sha256": "ab"},
        "curves": {"epoch": [0, 1, 2, 3], "training": [1.0, 0.5, 0.2, 0.1],
                   "validation": [] if rows else [1.0, 0.6, 0.3, 0.4], "best": 2, "stopped": "validation"},
    }  # fmt: skip
    if rows:
        return {
            **common, "in_sample": figures, "leave_one_out": figures, "mean_of_the_others": figures, "true_deg": values,
            "in_sample_deg": values, "leave_one_out_deg": values,
        }  # fmt: skip
    part = {"samples": 10, "network": figures, "mean": figures, "true_deg": values, "predicted_deg": values}
    return {
        **common,
        "parts": {
            "training": part, "validation": part, "test": {**part, "nearest_training_contacts": figures},
        },
        "states": {"1-2-2": {"samples": 10, **figures}},
        "floor": {"contacts": 100, "rms_deg": [0.5, 0.6, 0.7]},
        "data": {"folder": "run", "contacts": 10, "samples": 10, "made_by": "cell", "command": "c",
                 "cell_sha256": "cd"},
        "weights": "w",
    }  # fmt: skip


@pytest.mark.parametrize("rows", [False, True])
def test_the_page_of_a_training_stands_alone(rows: bool) -> None:
    page = render_training(json.loads(json.dumps(result_of_a_training(rows))))
    assert page.count("<svg") == 4 and not re.search(r"https?://|src=|@import", page)
    assert '<p class="bad">No epoch helped.</p>' in page
    assert "crosspih &lt;train&gt;" in page and "Figure 18" in page
    assert ("nine others" in page) == rows
    assert page == render_training(result_of_a_training(rows))


def test_a_tool_that_fails_is_said_to_have(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ToolFailed, match="ended with 2"):
        run_tool(["synthesise", "--poses", "many"], Console(stderr=True))
    assert "invalid int value" in capfd.readouterr().err
