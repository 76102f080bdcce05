"""`--from mount`: the newest folder in which something was taken."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.operator.calibrate.folder import FOUND, PRESSED, named_folder


def test_a_word_names_the_newest_that_holds_what_was_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CROSSPIH_RUN_DIR", str(tmp_path))
    root = tmp_path / "lab" / "calibration"
    for name, file in (("mount-20260101-000000", PRESSED), ("mount-20260102-000000", PRESSED), ("tcp-2026", PRESSED)):
        (root / name).mkdir(parents=True)
        (root / name / file).write_text("")
    offline = root / "mount-20260103-000000"
    offline.mkdir()
    (offline / FOUND).write_text("")
    assert named_folder("lab", Path("mount")) == root / "mount-20260102-000000"
    # what is there is meant, and what is nowhere is left to be refused by its name
    assert named_folder("lab", offline) == offline
    assert named_folder("lab", Path("stiffness")) == Path("stiffness")
    assert named_folder("lab", Path("some/where")) == Path("some/where")
