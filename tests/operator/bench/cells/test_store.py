"""What a run keeps and finds again: conditions, the code's version, and the store."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.errors import ConfigError
from crosspih_common.provenance import ResultStore, SourceWatch, code_version, folder_version, hash_sources, result_key
from crosspih_common.provenance.code import ASKED_BY, SCORED_BY
from services.operator.bench.cells.conditions import Condition, cell_content, condition_of, merged
from services.operator.bench.cells.trials import TrialJob, trial_key
from tests.system.source import ROOT

NAMES = st.sampled_from(["a", "b", "c"])
TREES = st.recursive(
    st.dictionaries(NAMES, st.integers(0, 3), max_size=3), lambda inner: st.dictionaries(NAMES, inner, max_size=3)
)


def _leaves(tree: dict[str, Any], at: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    found: dict[tuple[str, ...], Any] = {}
    for name, value in tree.items():
        found |= _leaves(value, (*at, name)) if isinstance(value, dict) else {(*at, name): value}
    return found


@settings(deadline=None)
@given(TREES, TREES)
def test_overrides_win_and_all_else_stays(base: dict[str, Any], overrides: dict[str, Any]) -> None:
    before = json.dumps(base)
    result = merged(base, overrides)
    assert json.dumps(base) == before
    wanted, kept = _leaves(overrides), _leaves(result)
    assert wanted.items() <= kept.items()
    # nothing new but what was asked for
    assert kept.keys() <= wanted.keys() | _leaves(base).keys()


def test_settings_are_typed_as_in_the_cell_file() -> None:
    condition = condition_of(["cell.hole.clearance_m=0.0002", "vision.enabled=false", "cell.name=b"])
    assert condition.overrides == {
        "cell": {"hole": {"clearance_m": 0.0002}, "name": "b"},
        "vision": {"enabled": False},
    }
    assert condition_of([]) == Condition()


@pytest.mark.parametrize("setting", ["clearance=1", "cell.hole.clearance_m", "cell..x=1", "cell.x=[1"])
def test_a_setting_that_is_none_is_refused_by_name(setting: str) -> None:
    with pytest.raises(ConfigError, match="--set"):
        condition_of([setting])


def test_an_empty_section_can_be_overridden() -> None:
    content = cell_content("cell:\nvision:\n", condition_of(["vision.enabled=false"]))
    assert content == {"cell": {}, "vision": {"enabled": False}}
    with pytest.raises(ConfigError, match="mapping"):
        cell_content("- a", Condition())


def test_a_trial_is_the_same_whatever_its_cell_and_condition_are_called() -> None:
    job = TrialJob(seed=1)
    renamed = TrialJob(seed=1, condition=Condition(name="other"))
    key = trial_key({"cell": {"name": "a"}}, job, "code")
    assert key == trial_key({"cell": {"name": "b"}}, renamed, "code")
    assert key != trial_key({"cell": {"name": "a"}}, TrialJob(seed=2), "code")
    assert key != trial_key({"cell": {"name": "a", "flange_to_ft_m": 0.07}}, job, "code")
    assert key != trial_key({"cell": {"name": "a"}}, job, "other code")


def test_what_was_put_is_there_for_the_next_run(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "trials.jsonl"
    key, other = result_key({"seed": 1}), result_key({"seed": 2})
    with ResultStore(path) as store:
        assert store.get(key) is None and len(store) == 0
        store.put(key, {"x": 0.1}, note="for people")
        store.put(other, {"x": 0.2})
        store.put(key, {"x": 0.3})
        # another reader sees it at once: nothing waits for the end of the run
        assert ResultStore(path).get(key) == {"x": 0.3}
    with ResultStore(path) as store:
        assert store.get(key) == {"x": 0.3} and store.get(other) == {"x": 0.2} and len(store) == 2


@settings(max_examples=20, deadline=None)
@given(st.integers(min_value=0, max_value=60))
def test_a_line_that_a_kill_cut_short_costs_that_line_only(tmp_path_factory: pytest.TempPathFactory, kept: int) -> None:
    path = tmp_path_factory.mktemp("store") / "trials.jsonl"
    with ResultStore(path) as store:
        store.put("first", {"x": 1})
        whole = len(path.read_bytes())
        store.put("second", {"x": 2})
    path.write_bytes(path.read_bytes()[: whole + kept])
    with ResultStore(path) as store:
        assert store.get("first") == {"x": 1}
        store.put("third", {"x": 3})
    again = ResultStore(path)
    assert again.get("first") == {"x": 1} and again.get("third") == {"x": 3}


def test_a_store_that_cannot_be_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--store"):
        ResultStore(tmp_path).put("key", {})


def _tree(root: Path, code: str) -> Path:
    for folder in ("crosspih_common", "services/hardware", "services/operator/scoring", "services/operator/assembly"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    (root / "crosspih_common/a.py").write_text(code, encoding="utf-8")
    for name in ("scoring/score", "assembly/session", "assembly/show"):
        (root / f"services/operator/{name}.py").write_text("x = 1\n", encoding="utf-8")
    return root


def test_the_code_version_is_of_what_the_code_does(tmp_path: Path) -> None:
    version = hash_sources(_tree(tmp_path, 'def f():\n    """One."""\n    return 1\n'))
    assert version == hash_sources(_tree(tmp_path, 'def f():\n    """Two."""\n\n    return 1  # why\n'))
    (tmp_path / "services/operator/assembly/show.py").write_text("x = 2\n", encoding="utf-8")
    assert version == hash_sources(tmp_path)
    (tmp_path / "services/operator/scoring/score.py").write_text("x = 2\n", encoding="utf-8")
    assert version != hash_sources(tmp_path)
    assert version != hash_sources(_tree(tmp_path, "def f():\n    return 2\n"))


def test_what_only_shows_has_no_say(tmp_path: Path) -> None:
    version = hash_sources(_tree(tmp_path, "x = 1\n"))
    shown = ["crosspih_common/foxglove/deep", "crosspih_common/client", "services/foxglove", "services/viewer"]
    for folder in shown:
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "new.py").write_text("x = 1\n", encoding="utf-8")
        assert hash_sources(tmp_path) == version, folder
    (tmp_path / "crosspih_common/client/assembly_request.py").write_text("x = 1\n", encoding="utf-8")
    assert hash_sources(tmp_path) != version, "which asks for the trials"


def test_what_scores_and_asks_is_where_the_code_version_looks_for_it() -> None:
    """A file that is renamed would drop out of every trial's key in silence."""
    assert all((ROOT / "services" / "operator" / name).is_file() for name in SCORED_BY)
    assert all((ROOT / "crosspih_common" / "client" / name).is_file() for name in ASKED_BY)


def test_a_folders_version_is_of_that_folder(tmp_path: Path) -> None:
    (tmp_path / "one/deep").mkdir(parents=True)
    (tmp_path / "one/deep/a.py").write_text("x = 1\n", encoding="utf-8")
    before = folder_version("one", tmp_path)
    (tmp_path / "two").mkdir()
    (tmp_path / "two/a.py").write_text("x = 1\n", encoding="utf-8")
    folder_version.cache_clear()
    assert folder_version("one", tmp_path) == before != folder_version("two", tmp_path)
    (tmp_path / "one/deep/a.py").write_text("x = 2\n", encoding="utf-8")
    folder_version.cache_clear()
    assert folder_version("one", tmp_path) != before


def test_a_run_notices_that_its_code_is_changed(tmp_path: Path) -> None:
    watch = SourceWatch(_tree(tmp_path, "x = 1\n"), hash_sources(tmp_path))
    assert watch.unchanged()
    _tree(tmp_path, "x = 1  # one\n")
    assert watch.unchanged()
    _tree(tmp_path, "x = 22\n")
    assert not watch.unchanged()
    _tree(tmp_path, "x = 1\n")
    assert not watch.unchanged(), "what was made in between is of other code"


def test_weights_count_as_code(tmp_path: Path) -> None:
    version = hash_sources(_tree(tmp_path, "x = 1\n"))
    (tmp_path / "services/hardware/net.safetensors").write_bytes(b"1")
    assert version != hash_sources(tmp_path)


def test_this_code_has_a_version() -> None:
    assert len(code_version()) == 16
