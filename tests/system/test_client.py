"""The client over the real processes: the README's lines, the notebook, and what becomes of a client that is killed."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from crosspih_common.client import connect
from crosspih_common.errors import CommandRefused
from crosspih_common.messages import Phase
from tests.system.running_cell import DEADLINE_S, ROOT, RunningCell

NOTEBOOK = ROOT / "docs" / "examples" / "first-assembly.ipynb"
ASSEMBLE = "from crosspih_common.client import connect\nconnect(timeout_s=60).assemble(seed=7, record=False)\n"


def python_blocks(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("page", ["README.md", "docs/client.md"])
def test_the_readmes_lines_run_as_they_stand(cell: RunningCell, page: str) -> None:
    lines = python_blocks(ROOT / page)[0]
    assert len([line for line in lines.splitlines() if line.strip()]) == 5
    if page != "README.md":
        assert lines == python_blocks(ROOT / "README.md")[0]
        return
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, cwd=ROOT, timeout=DEADLINE_S)
    assert done.returncode == 0, done.stderr
    inserted, force_n = done.stdout.split()
    assert inserted == "True" and 0.0 < float(force_n) < 60.0


def outputs(notebook: Any) -> dict[str, set[str]]:
    """What kinds of output each cell of code has, by its first line."""
    found = {}
    for one in notebook.cells:
        if one.cell_type == "code":
            kinds = [set(output.get("data", {})) or {output.output_type} for output in one.outputs]
            found[one.source.splitlines()[-1]] = set().union(*kinds)
    return found


def test_the_notebook_runs_and_shows_what_it_shows(cell: RunningCell) -> None:
    written: Any = nbformat.read(NOTEBOOK, 4)  # type: ignore[no-untyped-call]
    notebook: Any = nbformat.read(NOTEBOOK, 4)  # type: ignore[no-untyped-call]
    NotebookClient(notebook, timeout=DEADLINE_S, resources={"metadata": {"path": str(ROOT)}}).execute()
    assert outputs(notebook) == outputs(written)
    assert "image/png" in outputs(written)["recording.plot()"]
    text = "".join(output.get("text", "") for one in notebook.cells for output in one.get("outputs", []))
    assert "inserted: True" in text and "less than half a millimetre off: True" in text and "withdrawn: True" in text


def test_a_client_that_is_killed_leaves_the_assembly_to_planning(cell: RunningCell) -> None:
    with connect(timeout_s=DEADLINE_S) as other, other.stream("planning/phase", timeout_s=DEADLINE_S) as phases:
        began = other.bus.clock.now_ns()
        killed = subprocess.Popen([sys.executable, "-c", ASSEMBLE], cwd=ROOT)
        for told in phases:
            if told.stamp_ns > began and told.phase is Phase.PUSHING:
                os.kill(killed.pid, signal.SIGKILL)
                killed.wait(DEADLINE_S)
                break
        with pytest.raises(CommandRefused) as refused:
            other.withdraw()
        assert refused.value.code == "busy"
        last = next(told for told in phases if told.stamp_ns > began and told.phase is Phase.DONE)
        assert last.text == "inserted"


def test_a_strategy_that_planning_cannot_import_is_refused_by_name(cell: RunningCell) -> None:
    done = cell.cli("assemble", "--strategy", "my_lab.mine:RingSearch", "--no-record")
    assert done.returncode == 1 and "no module my_lab where the service runs" in done.stdout + done.stderr
