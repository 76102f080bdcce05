"""The cell's file that a command is told goes before the one of the environment, for as long as the command lasts."""

from __future__ import annotations

from pathlib import Path

import pytest

from crosspih_common.service.lifecycle import DEFAULT_CELL
from services.operator.session import cell_path, using_cell


def test_a_named_file_counts_while_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CROSSPIH_CELL", raising=False)
    with using_cell(Path("deploy/cells/panda.yaml")):
        assert cell_path() == "deploy/cells/panda.yaml"
    assert cell_path() == DEFAULT_CELL
    monkeypatch.setenv("CROSSPIH_CELL", "mine.yaml")
    with pytest.raises(RuntimeError), using_cell(Path("other.yaml")):
        raise RuntimeError
    assert cell_path() == "mine.yaml"
    with using_cell(None):
        assert cell_path() == "mine.yaml"
