"""Two assemblies side by side: figures with their differences, and settings that are equal or differ. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from services.operator.report.charts import TICK_S, Data, numbers, series, steps_of, times
from services.operator.report.model import Facts
from services.operator.report.model.motion import in_hole_m
from services.operator.report.numbers import Quantity
from services.operator.report.rows import peak_rows
from services.operator.report.thinning import thinned
from services.operator.report.tiles import tiles

COMMAND = "the command"
NOT_THERE = "–"


@dataclass(frozen=True, slots=True)
class FigureRow:
    """One figure of both; `difference` is the second minus the first, empty where one of them has none."""

    name: str
    one: Quantity
    other: Quantity

    @property
    def difference(self) -> Quantity:
        """The difference of the numbers as shown."""
        if self.one.value is None or self.other.value is None:
            return Quantity(None)
        digits = self.one.digits
        return Quantity(round(self.other.value, digits) - round(self.one.value, digits), self.one.unit, digits)


@dataclass(frozen=True, slots=True)
class SettingRow:
    """One setting of both as text."""

    name: str
    one: str
    other: str


def figure_rows(one: Facts, other: Facts) -> list[FigureRow]:
    """Every tile of either, the peaks without a tile, and the time in each phase."""
    first, second = _figures(one), _figures(other)
    rows = []
    for name in dict.fromkeys([*first, *second]):
        known = first.get(name) or second[name]
        missing = Quantity(None, known.unit, known.digits)
        rows.append(FigureRow(name, first.get(name, missing), second.get(name, missing)))
    return rows


def _figures(facts: Facts) -> dict[str, Quantity]:
    found = {tile.name: tile.value for tile in tiles(facts)}
    for row in peak_rows(facts)[1:]:
        found[f"{row.name}: |F|"], found[f"{row.name}: |M|"] = row.force, row.moment
    if facts.window.result is not None:
        found["in motion"] = Quantity(facts.window.result.motion_s, "s")
        found["thinking"] = Quantity(facts.window.result.thinking_s, "s")
    if facts.joints is not None:
        found["the tip's way"] = Quantity(facts.joints.tip_path_m(), "m", 3)
    for each in facts.times:
        found[f"phase {each.phase.value.replace('_', ' ')}"] = Quantity(each.cell_s, "s")
    return found


def setting_rows(one: Facts, other: Facts) -> tuple[list[SettingRow], list[SettingRow]]:
    """(those that differ, those that are equal): the request, the cell's file, and the versions."""
    first, second = dict(_settings(one)), dict(_settings(other))
    rows = [
        SettingRow(name, first.get(name, NOT_THERE), second.get(name, NOT_THERE))
        for name in dict.fromkeys([*first, *second])
    ]
    return [row for row in rows if row.one != row.other], [row for row in rows if row.one == row.other]


def _settings(facts: Facts) -> Iterator[tuple[str, str]]:
    yield "peg", facts.outline
    if facts.window.result is not None:
        yield "strategy", facts.window.result.strategy.value
    if facts.truth is not None:
        yield "seed", str(facts.truth.seed)
    if facts.forces.calibration is not None:
        yield "calibration of", facts.forces.calibration.date or "unknown"
    yield from _flat("", facts.configuration)
    for name, version in facts.recording.metadata.get("versions", {}).items():
        yield f"version of {name}", version


def _flat(before: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(f"{before}.{name}" if before else str(name), inner)
    elif isinstance(value, list):
        yield before, ", ".join(map(str, value))
    else:
        yield before, str(value)


def begins(facts: Facts) -> dict[str, float]:
    """When each phase first began, s since the command; without calibrating, by which nothing is aligned."""
    found = {COMMAND: 0.0}
    for span in facts.spans:
        if span.start_s >= facts.calibrated_s:
            found.setdefault(span.message.phase.value.replace("_", " "), round(span.start_s, 4))
    return found


def compared_charts(one: Facts, other: Facts) -> Data:
    """Both in one chart each, for the page's script: |F|, |M| and the depth of the tip, aligned at a phase."""
    both = (one, other)
    marks = [begins(facts) for facts in both]
    common = [name for name in marks[0] if name in marks[1]]
    spans, bands = {}, {}
    for name in common:
        ends = [(facts.calibrated_s - at[name], facts.end_s - at[name]) for facts, at in zip(both, marks, strict=True)]
        spans[name] = [round(min(start for start, _ in ends), 4), round(max(end for _, end in ends), 4)]
        bands[name] = [
            {**band, "start": round(band["start"] - marks[0][name], 4), "end": round(band["end"] - marks[0][name], 4)}
            for band in steps_of(one)
            if band["start"] >= one.calibrated_s
        ]
    first = common[-1] if "pushing" not in common else "pushing"
    return {
        "tick": TICK_S, "start": spans[first][0], "end": spans[first][1], "phases": bands[first], "free": [],
        "touches": [], "aligned": marks, "spans": spans, "bands": bands, "first": first, "common": common,
        "charts": [chart for chart in (_forces(both, "F"), _forces(both, "M"), _depth(both)) if chart["parts"]],
    }  # fmt: skip


def _lines(what: str) -> list[Data]:
    return [series(f"A {what}", "a-line"), series(f"B {what}", "b-line")]


def _forces(both: tuple[Facts, Facts], symbol: str) -> Data:
    unit, step, name = ("N", 0.01, "force") if symbol == "F" else ("Nm", 0.001, "moment")
    traces = [facts.forces.main for facts in both]
    # both filtered, or both not: otherwise the filter would make a difference
    if any(facts.forces.unfiltered is None for facts in both):
        traces = [facts.forces.filtered for facts in both]
    parts = []
    for trace in traces:
        if trace is not None:
            values = trace.force_n if symbol == "F" else trace.moment_nm
            keep = thinned(values[:, None], np.where(trace.free, 0.0, values), 900)
            parts.append({"t": times(trace.time_s[keep]), "y": [numbers(values[keep], step)]})
    filtered = "filtered" if any(facts.forces.unfiltered is None for facts in both) else "unfiltered"
    return {
        "id": name, "unit": unit, "step": step, "digits": 2 if unit == "N" else 3, "strip": symbol == "F",
        "label": f"contact {name} / {unit}", "says": filtered, "series": _lines(f"|{symbol}|"), "height": 300,
        "parts": parts if len(parts) == 2 else [],
    }  # fmt: skip


def _depth(both: tuple[Facts, Facts]) -> Data:
    parts = []
    for facts in both:
        if facts.joints is not None:
            depth_mm = in_hole_m(facts.joints, facts.reference)[:, 2] * 1e3
            keep = thinned(depth_mm[:, None], None, 900)
            parts.append({"t": times(facts.joints.time_s[keep]), "y": [numbers(depth_mm[keep], 0.001)]})
    return {
        "id": "depth", "unit": "mm", "step": 0.001, "digits": 2, "strip": False, "label": "tip into the hole / mm",
        "says": "", "series": _lines("z"), "height": 220, "parts": parts if len(parts) == 2 else [],
    }  # fmt: skip
