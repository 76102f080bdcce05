"""One running cell for all tests of this folder: starting it costs more than most of them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from services.operator.assembly.session import Session
from tests.system.running_cell import RunningCell


@pytest.fixture(scope="package")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningCell]:
    """The real services as processes; the first assembly has calibrated the force/torque sensor."""
    with pytest.MonkeyPatch.context() as environment:
        running = RunningCell(tmp_path_factory.mktemp("cell"), "system", environment)
        running.start()
        try:
            yield running
        finally:
            running.stop()


@pytest.fixture
def session(cell: RunningCell) -> Iterator[Session]:
    """A place on the bus, once all services live."""
    with cell.session() as opened:
        yield opened
