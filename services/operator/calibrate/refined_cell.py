"""The parts that `crosspih calibrate refine` and `bench refine` share: the tool, its table, the refined cell's file."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from crosspih_common.config import PegDrawing, Workcell, load_cell, with_correction_moved
from services.operator.bench.cells.conditions import merged
from services.operator.other_services.inference_process import run_tool

HEADER = "# {base}, refined by `crosspih calibrate refine` over {count} assemblies; calibrate the F/T sensor anew.\n"
UNITS = {"taper": (1e2, "%"), "clearance": (1e3, "mm")}


def shown_in(name: str) -> tuple[float, str]:
    """How a parameter is shown: factor and unit."""
    if name in UNITS:
        return UNITS[name]
    return (180.0 / np.pi, "°") if name.rsplit("_", 1)[-1].startswith("r") else (1e3, "mm")


def refined_content(base: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
    """The cell's file with the refined settings. A simulated cell stays the same machine: each difference to the
    drawing in `hardware.simulated.truth` is rewritten relative to the new drawing.
    """
    base = with_correction_moved({name: {} if section is None else section for name, section in base.items()})
    content = merged(base, settings)
    truth = ((base.get("hardware") or {}).get("simulated") or {}).get("truth")
    changed = {name for name in settings.get("cell") or {} if name in ("peg", "hole")}
    if (base.get("hardware") or {}).get("driver", "simulated") != "simulated" or not changed:
        return content
    before, after = (Workcell.model_validate(one.get("cell") or {}) for one in (base, content))
    kept = copy.deepcopy(truth or {})
    if "peg" in changed:
        steeper = _taper(after.peg) / _taper(before.peg)
        kept["taper_slope_factor"] = float(kept.get("taper_slope_factor", 1.0)) / steeper
    if "hole" in changed:
        wider = after.hole.clearance_m - before.hole.clearance_m
        kept["clearance_offset_m"] = float(kept.get("clearance_offset_m", 0.0)) - wider
    return merged(content, {"hardware": {"simulated": {"truth": kept}}})


def _taper(drawing: PegDrawing) -> float:
    """How much the section shrinks over the taper, as a share of the body."""
    peg = drawing.shape()
    return 1.0 - float(peg.scale_at(peg.tip_m))


def run_refine(recordings: Sequence[Path], cell: Path, console: Console) -> dict[str, Any]:
    """The refinement as the inference service's tool prints it. Raises ToolFailed."""
    words = [*(str(path) for path in recordings), "--cell", str(cell)]
    return run_tool(words, console, "services.inference.cell_refinement")


def refined_table(result: dict[str, Any]) -> Table:
    """Every parameter before and after, with the change found and its uncertainty."""
    table = Table(
        title=f"{result['assemblies']} assemblies: {result['touches']} touches, {result['presses']} presses, "
        f"{result['seen']} seen, {result['calibrations']} calibrations of the sensor"
    )
    for name in ("", "before", "found", "sd", "tolerance", "after"):
        table.add_column(name, justify="left" if not name else "right")
    for one in result["parameters"]:
        factor, unit = shown_in(one["name"])
        figures = [f"{one[name] * factor:+.3f}" for name in ("before", "found")]
        spread = [f"{one[name] * factor:.3f}" for name in ("sd", "prior_sd")]
        after = f"{one['value'] * factor:+.3f} {unit}" if one["taken"] else "as it was"
        table.add_row(one["name"], *figures, *spread, after, style="" if one["taken"] else "dim")
    return table


def residual_lines(result: dict[str, Any]) -> list[str]:
    """How the residuals fell."""
    lines = ["contacts: {:.2f} sd before, {:.2f} sd after".format(*result["contact_rms"])]
    if result["vision_rms"] is not None:
        lines.append("vision:   {:.2f} sd before, {:.2f} sd after".format(*result["vision_rms"]))
    return lines


def write_cell(out: Path, base: dict[str, Any], result: dict[str, Any], name: str) -> dict[str, Any]:
    """Write the cell's file with the refined values, checked; returns its content."""
    content = refined_content(base, result["settings"])
    out.parent.mkdir(parents=True, exist_ok=True)
    header = HEADER.format(base=name, count=result["assemblies"])
    out.write_text(header + yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    load_cell(out)
    return content
