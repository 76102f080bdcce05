"""`crosspih down` ends every process of a running cell."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.operator.cli.commands import app
from tests.deploy.harness import is_alive
from tests.system.running_cell import SERVICES, RunningCell, wait_until


def test_down_leaves_no_process(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as environment:
        cell = RunningCell(tmp_path, "stopped", environment)
        cell.start()
        try:
            pids = cell.pids()
            assert set(pids) == {"launcher", *SERVICES}
            assert all(is_alive(pid) for pid in pids.values())
            done = cell.cli("down")
            assert done.returncode == 0, done.stderr
            # nobody waits for the launcher's own process but its parent, which is this one: dead is what counts
            wait_until(lambda: not any(is_alive(pid) for pid in pids.values()), "every process has ended")
            again = CliRunner().invoke(app, ["ps", "--json"])
            assert again.exit_code != 0 and '"up": false' in again.stdout
        finally:
            cell.stop()
