"""Settings that a person types, `--set section.name=value`: checked by their service before anything starts."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import yaml

from crosspih_common.config import cell_of_text
from crosspih_common.config.cell import SERVICES
from crosspih_common.errors import ConfigError
from services.operator.bench.cells.conditions import cell_content, condition_of
from services.operator.bench.cells.trials import base_cell_text
from services.operator.other_services.beside import run_module

NOT_READ = ("router", "operator")  # the router has no settings, and the operator's own are read when they are used


def require_settings(settings: Sequence[str]) -> None:
    """Raise ConfigError for a setting that is not valid, with the message of the service that reads it.

    Each named section is read by `python -m services.NAME --check-config`, which takes about 1 s.
    """
    if not settings:
        return
    condition = condition_of(settings)
    text = yaml.safe_dump(cell_content(base_cell_text(), condition), sort_keys=False)
    cell_of_text(Path("--set"), text)
    with tempfile.TemporaryDirectory(prefix="crosspih-set-") as folder:
        path = Path(folder) / "cell.yaml"
        path.write_text(text, encoding="utf-8")
        for name in condition.overrides:
            if name not in SERVICES or name in NOT_READ:
                continue
            said = run_module(f"services.{name}", "--check-config", "--cell", str(path))
            if isinstance(said.value, dict) and "wrong" in said.value:
                why = str(said.value["wrong"]).replace(str(path), "--set")
                raise ConfigError(
                    why, field=" ".join(settings), mend="crosspih doctor reads the whole of a cell's file"
                )
