"""The charts of a report as plain numbers for the page's script. Pure: every number comes from the facts."""

from __future__ import annotations

from typing import Any

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.recording.plotting import LINES, PHASE_COLOURS
from services.operator.report.model import Facts
from services.operator.report.model.forces import Trace
from services.operator.report.model.motion import in_hole_m
from services.operator.report.thinning import thinned

JOINTS = ("#d9534f", "#d08a1d", "#2f9e6e", "#3f8fd6", "#8f6fd1", "#c46bb0", "#7d8590")
INTEREST_N = 1.0  # above it each sample of a contact is drawn
TICK_S = 1e-4
Data = dict[str, Any]


def numbers(values: Array, unit: float) -> list[int]:
    """(n,) as whole multiples of a unit: short in the file, and exact to the digits shown."""
    return np.round(np.asarray(values) / unit).astype(int).tolist()  # type: ignore[no-any-return]


def times(time_s: Array) -> list[int]:
    """(n,), s, as steps of `TICK_S`; each after the first is the difference to the one before."""
    return np.diff(np.round(np.asarray(time_s) / TICK_S).astype(int), prepend=0).tolist()  # type: ignore[no-any-return]


def series(label: str, colour: str, **more: Any) -> Data:
    """The style of one curve; `colour` is a colour or the name of one of the page's own."""
    return {"label": label, "colour": colour, **more}


def force_charts(facts: Facts) -> list[Data]:
    """The paper's Figure 19: force and moment of contact, unfiltered and filtered where both are recorded."""
    traces = [
        (f"unfiltered, {trace.rate_hz:.0f} Hz" if trace is facts.forces.unfiltered else
         f"filtered, {trace.rate_hz:.0f} Hz", trace)
        for trace in (facts.forces.unfiltered, facts.forces.filtered)
        if trace is not None
    ]  # fmt: skip
    rows = [(name, trace, _force_rows(trace)) for name, trace in traces]
    charts = []
    for first, symbol, unit, step, what in ((0, "F", "N", 0.01, "force"), (3, "M", "Nm", 0.001, "moment")):
        sets = []
        for name, trace, keep in rows:
            columns = [trace.wrench[keep, first + axis] for axis in range(3)]
            columns.append(trace.force_n[keep] if symbol == "F" else trace.moment_nm[keep])
            sets.append({"label": name, "t": times(trace.time_s[keep]), "y": [numbers(each, step) for each in columns]})
        if sets:
            lines = [series(f"{symbol}{axis}", colour) for axis, colour in zip("xyz", LINES, strict=True)]
            lines.append(series(f"|{symbol}|", "quiet", width=1))
            charts.append(
                {
                    "id": what, "unit": unit, "step": step, "digits": 2 if unit == "N" else 3,
                    "label": f"contact {what} / {unit}", "series": lines, "sets": sets, "free": True, "touches": True,
                    "strip": symbol == "F", "height": 300 if symbol == "F" else 230,
                }
            )  # fmt: skip
    return charts


def _force_rows(trace: Trace) -> Array:
    columns = np.column_stack([trace.wrench, trace.force_n, trace.moment_nm])
    interest = np.where(trace.free, 0.0, np.clip(trace.force_n - INTEREST_N, 0.0, None))
    # the peaks of contact and of free air separately: a bucket may hold both
    peaks = [
        index[int(np.argmax(values[index]))]
        for values in (trace.force_n, trace.moment_nm)
        for index in (np.flatnonzero(trace.free), np.flatnonzero(~trace.free))
        if len(index)
    ]
    return np.unique(np.concatenate([thinned(columns, interest), np.array(peaks, dtype=int)]))


def motion_charts(facts: Facts) -> list[Data]:
    """The trajectory with the arm's limits, and the path of the tip in the hole's frame."""
    trace = facts.joints
    if trace is None:
        return []
    limits = facts.workcell.arm().limits
    tip_mm = in_hole_m(trace, facts.reference) * 1e3
    speed = trace.speeds_rad_s / limits.speed_rad_s * 100.0
    acceleration = trace.accelerations_rad_s2 / limits.acceleration_rad_s2 * 100.0
    degrees = np.degrees(trace.positions_rad)
    keep = thinned(np.column_stack([degrees, speed, acceleration, tip_mm]))
    names = [f"J{index + 1}" for index in range(degrees.shape[1])]
    joints = [series(name, JOINTS[index % len(JOINTS)]) for index, name in enumerate(names)]
    charts = []
    for what, columns, label, unit, step, digits, limit in (
        ("position", degrees, "joint angle / °", "°", 0.01, 2, False),
        ("speed", speed, "speed / % of the joint's limit", "%", 0.01, 1, True),
        ("acceleration", acceleration, "acceleration / % of limit", "%", 0.01, 1, True),
    ):
        one = {"label": "", "t": times(trace.time_s[keep]), "y": [numbers(each, step) for each in columns[keep].T]}
        charts.append(
            {
                "id": what, "unit": unit, "step": step, "digits": digits, "label": label, "series": joints,
                "sets": [one], "limits": [-100, 100] if limit else [], "strip": what == "position", "height": 190,
            }
        )  # fmt: skip
    way = [series("x across", LINES[0]), series("y across", LINES[1]), series("z into the hole", LINES[2])]
    one = {"label": "", "t": times(trace.time_s[keep]), "y": [numbers(each, 0.001) for each in tip_mm[keep].T]}
    charts.append(
        {
            "id": "tip", "unit": "mm", "step": 0.001, "digits": 2, "label": "tip in the hole's frame / mm",
            "series": way, "sets": [one], "limits": [], "touches": True, "strip": True, "height": 220,
        }
    )  # fmt: skip
    return charts


def steps_of(facts: Facts) -> list[Data]:
    """The bands behind the curves: consecutive steps of one phase as one band."""
    bands: list[Data] = []
    for span in facts.spans:
        name = span.message.phase.value.replace("_", " ")
        if bands and bands[-1]["name"] == name and abs(bands[-1]["end"] - span.start_s) < 1e-6:
            bands[-1]["end"] = round(span.end_s, 4)
        elif span.end_s > span.start_s:
            colour = PHASE_COLOURS.get(span.message.phase, "#888888")
            bands.append({"name": name, "start": round(span.start_s, 4), "end": round(span.end_s, 4), "colour": colour})
    return bands


def chart_data(facts: Facts) -> Data:
    """The data for the page's script, for JSON."""
    return {
        "tick": TICK_S,
        "start": round(facts.calibrated_s, 4),
        "end": round(facts.end_s, 4),
        "phases": steps_of(facts),
        "free": [[round(start, 4), round(end, 4)] for start, end in facts.forces.free_spans],
        "touches": [{"label": str(each.number), "t": round(each.time_s, 4)} for each in facts.touches]
        + [{"label": f"p{each.number}", "t": round(each.time_s, 4)} for each in facts.presses],
        "charts": [*force_charts(facts), *motion_charts(facts)],
    }
