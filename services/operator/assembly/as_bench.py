"""Repeats one trial of a bench where it can be watched: `crosspih assemble --as-bench`."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from crosspih_common.modules import DEFAULT_CELL
from services.operator.assembly.session import Session
from services.operator.bench.cells.conditions import DEFAULT_PEG, cell_content
from services.operator.bench.cells.own_cell import OwnCell
from services.operator.bench.cells.trials import TrialJob, base_cell_text, trial_task
from services.operator.cell.which_cell import cell_path


@contextmanager
def bench_session(job: TrialJob, record: bool) -> Iterator[Session]:
    """A session on a separate stack, started and calibrated as a bench does it for this trial; stopped at the end.

    Raises CrosspihError or LauncherError.
    """
    before = dict(os.environ)
    cell = OwnCell(0, trial_task(job, cell_content(base_cell_text(), job.condition, job.peg), record))
    try:
        yield cell.start()
    finally:
        cell.close()
        # the cell's own variables name a folder that no longer exists
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)


def _settings(overrides: Mapping[str, Any], at: tuple[str, ...] = ()) -> Iterator[str]:
    """Overrides as `--set` takes them; JSON is YAML too."""
    for name, value in overrides.items():
        if isinstance(value, Mapping):
            yield from _settings(value, (*at, name))
        else:
            yield f"{'.'.join((*at, name))}={json.dumps(value)}"


def watch_command(job: TrialJob) -> str:
    """The command that repeats this trial of a bench, with its phases, its recording and its report."""
    words = ["crosspih", "assemble", "--as-bench", "--seed", str(job.seed)]
    if job.known is not None:
        words.append("--after-cross")
    else:
        words += ["--strategy", job.strategy.value]
    if job.peg != DEFAULT_PEG:
        words += ["--peg", job.peg]
    if cell_path() != DEFAULT_CELL:
        words += ["--cell", cell_path()]
    for setting in _settings(job.condition.overrides):
        words += ["--set", setting]
    return shlex.join(words)
