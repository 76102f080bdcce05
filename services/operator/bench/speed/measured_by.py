"""Measuring programs of other services, run as processes of their own: the operator imports none of them."""

from __future__ import annotations

import json
import subprocess
from typing import Any

from rich.console import Console

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command
from services.operator.bench.cells.bar import Bar


def measured_by(program: str, who: str, *options: str, console: Console) -> Any:
    """The output of such a program; a bar shows meanwhile that it is at work. Raises CrosspihError where it dies."""
    with Bar(console, counted=False) as bar:
        bar.add_task(who, total=None)
        done = subprocess.run(module_command(program, *options), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise CrosspihError(f"{who}: {(done.stderr.strip().splitlines() or ['it died'])[-1]}")
    # PyBullet prints a greeting on standard output
    return json.loads(done.stdout.strip().splitlines()[-1])
