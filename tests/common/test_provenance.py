"""Stores answer for what they measured and for nothing else: content, settings and code are of every key."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from crosspih_common.datasets import ContactRow, ContactWriter, DatasetError, DatasetOrigin
from crosspih_common.errors import ConfigError
from crosspih_common.messages import Phase
from crosspih_common.provenance import (
    MEASURED_VARIABLE,
    ResultStore,
    cell_identity,
    code_version,
    measured_in,
    part_version,
    with_file_contents,
)
from services.inference.estimator.__main__ import trials
from services.inference.estimator.coverage import TouchRecord
from services.operator.bench.calibrations.command import ABOUT, MADE_BY, PUSHES, check_free, check_kept, taken_with
from services.operator.bench.cells.trials import TrialJob, trial_key
from services.operator.bench.protocols.walked import check_walk, note_walk
from services.operator.bench.reliability.fuzz.rests_on import part_key
from services.operator.bench.reliability.matrix import command as matrix
from services.operator.bench.reliability.matrix.plan import MatrixCase, ProcessEnding
from services.operator.dataset.commands.collect import cell_sha256


def test_weights_that_were_trained_anew_are_another_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Train, bench, train again under the same name: what the old network did must not be given for the new one's."""
    weights, copy = tmp_path / "network.safetensors", tmp_path / "copy.safetensors"
    weights.write_bytes(b"old")
    copy.write_bytes(b"old")
    content: dict[str, Any] = {"cell": {}, "inference": {"weights": str(weights)}}
    old, collected = trial_key(content, TrialJob(seed=1), "code"), cell_sha256(content)
    assert old == trial_key({"cell": {}, "inference": {"weights": str(copy)}}, TrialJob(seed=1), "code")
    weights.write_bytes(b"anew")
    assert old != trial_key(content, TrialJob(seed=1), "code") and collected != cell_sha256(content)
    # a relative name means what lies where services run
    monkeypatch.setenv("CROSSPIH_DATA", str(tmp_path))
    assert with_file_contents("network.safetensors") == with_file_contents(str(weights)) != "network.safetensors"
    assert with_file_contents(["fused", "", 3, None]) == ["fused", "", 3, None]


def test_a_cell_is_itself_whatever_its_name() -> None:
    assert cell_identity({"cell": {"name": "a", "x": 1}}) == cell_identity({"cell": {"name": "b", "x": 1}})
    assert cell_identity({"cell": {"x": 1}}) != cell_identity({"cell": {"x": 2}})


def _record(trial: int) -> list[TouchRecord]:
    return [TouchRecord(trial, 1, {"lateral": 1.0}, 1e-3, 0.1, 0.0, 1, True, 1)]


def test_coverage_resumes_what_the_same_settings_made_only(tmp_path: Path) -> None:
    made: list[int] = []

    def make(seed: int) -> list[TouchRecord]:
        made.append(seed)
        return _record(seed)

    out = tmp_path / "p.jsonl"
    first = trials(make, range(2), {"prior": "poor"}, out)
    assert trials(make, range(3), {"prior": "poor"}, out) == first | {2: _record(2)} and made == [0, 1, 2]
    trials(make, range(2), {"prior": "vision"}, out)
    assert made == [0, 1, 2, 0, 1], "another prior's trials were given for these"


def test_a_store_says_what_it_gives_from_when_and_how_long_it_took(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = tmp_path / "measured"
    with ResultStore(tmp_path / "a.jsonl") as store:
        store.put("one", {"x": 1}, code="this", took_s=2.5)
        store.put("two", {"x": 2}, code="that", took_s=1.0)
    monkeypatch.setenv(MEASURED_VARIABLE, str(told))
    with ResultStore(tmp_path / "a.jsonl") as store:
        assert store.get("one") == {"x": 1} and store.get("none") is None
        store.put("three", {"x": 3}, code="this")
        said = store.reuse_summary("this")
        assert "1 taken over" in said and "by this code (this)" in said and "1 in" in said and "other code" in said
    found = measured_in(told)
    assert (found.taken, found.made, found.taken_s) == (1, 1, 2.5) and found.first == found.last != ""


def test_a_data_set_is_what_its_command_and_code_make(tmp_path: Path) -> None:
    origin = DatasetOrigin(made_by="t", command="c", first_seed=5, poses=2, cell_sha256="", settings={}, code="old")
    with ContactWriter(tmp_path, origin) as writer:
        writer.put([ContactRow(seed=seed, pose_seed=seed, angles_rad=(0.0, 0.0, 0.0)) for seed in (5, 6)])
    with ContactWriter(tmp_path, origin.model_copy(update={"poses": 3})) as more:
        assert more.done == {5, 6}
    with pytest.raises(DatasetError, match=r"by other code \(old, not new\)"):
        ContactWriter(tmp_path, origin.model_copy(update={"code": "new"}))
    with pytest.raises(DatasetError, match="2 contacts that this command does not make"):
        ContactWriter(tmp_path, origin.model_copy(update={"first_seed": 7}))


@pytest.mark.parametrize("changed", ["cell", "code"])
def test_a_death_is_of_its_cell_and_code(changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = MatrixCase(victim="router", phase=Phase.PUSHING, ending=ProcessEnding.KILL, seed=1)
    before = matrix.case_key(case, "max")
    if changed == "cell":
        cell = tmp_path / "cell.yaml"
        cell.write_text("cell: {flange_to_ft_m: 0.07}\n", encoding="utf-8")
        monkeypatch.setenv("CROSSPIH_CELL", str(cell))
    else:
        monkeypatch.setattr(matrix, "code_version", lambda *modules: "other")
    assert before != matrix.case_key(case, "max") != matrix.case_key(case, "realtime")


def test_what_answers_a_payload_is_of_the_key() -> None:
    assert part_key("arm/dwell", 10, 1, {"cell": {"a": 1}}) != part_key("arm/dwell", 10, 1, {"cell": {"a": 2}})


def test_kept_calibrations_are_worked_on_with_their_own_settings(tmp_path: Path) -> None:
    payload = {"what": PUSHES, "seed": 1, "presses": 16, "force_n": 18.0, "content": {"cell": {}}}
    console = Console(record=True, width=300)
    check_free(tmp_path)
    (tmp_path / ABOUT).write_text(json.dumps(taken_with(payload) | {"code": "old"}), encoding="utf-8")
    check_kept(tmp_path, payload, console)
    assert f"taken by code old, worked on by {code_version(*MADE_BY)}" in console.export_text()
    with pytest.raises(ConfigError, match="presses 16, not 20"):
        check_kept(tmp_path, payload | {"presses": 20}, console)
    with pytest.raises(ConfigError, match="cell"):
        check_kept(tmp_path, payload | {"content": {"cell": {"x": 1}}}, console)
    with pytest.raises(ConfigError, match="--keep"):
        check_free(tmp_path)


def test_a_day_is_gone_on_with_in_the_cell_that_it_was_begun_in(tmp_path: Path) -> None:
    console = Console(record=True, width=300)
    check_walk(tmp_path, console, hidden=1)
    assert "does not record" in console.export_text()
    note_walk(tmp_path, 1, 7)
    check_walk(tmp_path, console, hidden=1, seed=7)
    assert console.export_text() == ""
    with pytest.raises(ConfigError, match="--hidden 1, not 2"):
        check_walk(tmp_path, console, hidden=2)


def test_a_part_of_the_code_has_a_version_of_its_own() -> None:
    shapes = part_version("crosspih_common.shapes")
    assert len(shapes) == 16 and shapes != part_version("crosspih_common.geometry")
    assert shapes != part_version("crosspih_common.shapes", libraries=("numpy",))
    assert code_version() != code_version("services.operator.dataset.contact")
