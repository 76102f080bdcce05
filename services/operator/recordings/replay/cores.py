"""force_torque and planning replayed: their cores, each in a separate process, on the recorded data."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import yaml

from crosspih_common.errors import ConfigError
from services.operator.other_services.beside import run_module

CORES = {"force_torque": "services.force_torque.again", "planning": "services.planning.again"}
DEADLINE_S = 1800.0


def again(service: str, content: dict[str, Any], file: Path, from_s: float) -> dict[str, Any]:
    """{"parts": {name: [equal, all]}, "differences": [...], "notes": [...]}. Raises ConfigError where it cannot be
    replayed.
    """
    with tempfile.TemporaryDirectory(prefix="crosspih-replay-") as folder:
        cell = Path(folder) / "cell.yaml"
        cell.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        arguments = (str(file.resolve()), "--cell", str(cell), "--from", str(from_s))
        said = run_module(CORES[service], *arguments, deadline_s=DEADLINE_S)
    if not isinstance(said.value, dict):
        raise ConfigError(f"{service}: {said.words}")
    return said.value


def summary(service: str, outcome: dict[str, Any]) -> str:
    """One line."""
    parts = outcome["parts"]
    if not parts:
        return f"{service}: nothing in it can be asked again"
    counted = ", ".join(f"{equal} of {every} {name}" for name, (equal, every) in parts.items())
    return f"{service}: {counted} are equal bit for bit"


def all_equal(outcome: dict[str, Any]) -> bool:
    """Whether there is no difference."""
    return all(equal == every for equal, every in outcome["parts"].values()) and not outcome["differences"]
