"""torch and trained weights, where the strategy needs them."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from crosspih_common.messages import Strategy
from crosspih_common.modules import ALL_PACKAGES
from services.operator.cli.rows import Row, ok, wrong
from services.operator.other_services.beside import ROOT

SHIPPED = ROOT / "services" / "inference" / "network"
# the setting of the section `inference`, and the shipped file, of each strategy that uses a network
NETWORKS = {
    Strategy.PAPER: ("weights", "paper/weights.safetensors"),
    Strategy.NETWORK_SPIRAL: ("weights", "paper/weights.safetensors"),
    Strategy.SEQUENCE: ("sequence_weights", "sequence/weights.safetensors"),
}


def weight_rows(strategy: Strategy, inference: dict[str, Any], torch: str = "torch") -> Iterator[Row]:
    """The rows for one strategy; `torch` is the name of the package that runs networks."""
    if strategy not in NETWORKS:
        yield ok("networks", f"the strategy {strategy.value} needs none")
        return
    for module in (torch, "safetensors"):
        if find_spec(module) is None:
            yield wrong(
                "networks", f"the strategy {strategy.value} needs {module}, which is not installed", ALL_PACKAGES
            )
            return
    setting, shipped = NETWORKS[strategy]
    named = str(inference.get(setting) or "")
    file = Path(named) if named else SHIPPED / shipped
    if not file.is_file():
        yield wrong("networks", f"{file} is not there", f"crosspih train, then inference.{setting} in the cell's file")
        return
    yield ok("networks", f"{file.name}, {file.stat().st_size / 1e3:.0f} kB")
