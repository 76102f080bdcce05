"""Runs a tool of the inference service as a process and shows its progress: only that service has
mechanics and torch.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command
from services.operator.bench.cells.bar import Bar


class ToolFailed(CrosspihError):
    """The process ended without a result; its own messages are printed above."""


def run_tool(arguments: Sequence[str], console: Console, module: str = "services.inference.network") -> dict[str, Any]:
    """Run `python -m services.inference.network` (or another tool) with these arguments until it prints its result.

    The process writes JSON lines: {"doing", "done", "total"} while it works, and at the end {"result"} or {"error"}
    with a text. Raises ToolFailed.
    """
    result: dict[str, Any] | None = None
    refused: str | None = None
    command = module_command(module, *arguments)
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
        Bar(console) as progress,
    ):
        assert process.stdout is not None
        task, doing = None, ""
        for line in process.stdout:
            try:
                said = json.loads(line)
            except ValueError:
                progress.console.print(line.rstrip(), highlight=False, markup=False)
                continue
            if "error" in said:
                refused = str(said["error"])
                continue
            if "result" in said:
                result = said["result"]
                continue
            if task is None or not said["doing"].startswith(doing):
                doing = said["doing"].split(":")[0]
                task = progress.add_task(said["doing"], total=said["total"])
            progress.update(task, completed=said["done"], total=said["total"], description=said["doing"])
    if refused is not None:
        raise ToolFailed(refused)
    if process.returncode != 0 or result is None:
        told = f"python -m {module} {arguments[0]} ended with {process.returncode}; its own words stand above"
        raise ToolFailed(told)
    return result
