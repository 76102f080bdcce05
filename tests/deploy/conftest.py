"""What the tests of the launcher share."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.deploy.harness import ROOT, Stacks


@pytest.fixture
def stacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stacks]:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    made = Stacks(tmp_path)
    yield made
    made.close()
