"""A module of another service, run as a separate process: services do not import each other."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import deploy
from crosspih_common.modules import module_command

ROOT = Path(deploy.__file__).resolve().parent.parent
LONG_S = 120.0
WORDS = 400


@dataclass(frozen=True, slots=True)
class ModuleOutput:
    """The module's output: `value`, the JSON on its standard output, None where there is none; then `words` say why."""

    value: Any
    words: str
    status: int | None


def run_module(
    module: str, *arguments: str, env: dict[str, str] | None = None, deadline_s: float = LONG_S
) -> ModuleOutput:
    """The JSON that `python -m MODULE` prints."""
    path = os.pathsep.join(part for part in (str(ROOT), os.environ.get("PYTHONPATH", "")) if part)
    try:
        done = subprocess.run(
            module_command(module, *arguments),
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=deadline_s, check=False,
            env={**os.environ, "PYTHONPATH": path, **(env or {})},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return ModuleOutput(None, f"no answer within {deadline_s:g} s", None)
    try:
        return ModuleOutput(json.loads(done.stdout), "", done.returncode)
    except ValueError:
        said = " ".join(done.stderr.split()) or f"ended with status {done.returncode} and said nothing"
        return ModuleOutput(None, said[-WORDS:], done.returncode)
