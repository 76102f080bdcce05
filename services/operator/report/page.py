"""The HTML page: turns facts into words, numbers and pictures, and fills the template. One file, and no network."""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path
from typing import Any

import jinja2
import yaml

from crosspih_common.geometry.pose import Array
from crosspih_common.recording import read_recording
from crosspih_common.recording.plotting import PHASE_COLOURS
from services.operator.report.charts import chart_data
from services.operator.report.model import Facts, facts_of
from services.operator.report.numbers import Quantity, number
from services.operator.report.rows import matrix_text, peak_rows, pose_rows, touch_row
from services.operator.report.stills import stills_of
from services.operator.report.tiles import tiles
from services.operator.report.words import counted, how, verdict

HERE = Path(__file__).parent
TEMPLATES, VENDORED = HERE / "template", HERE / "vendored"


def environment() -> jinja2.Environment:
    """The templates, with the filters that they use."""
    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["number"] = number
    made.globals["counted"] = counted
    return made


def scripts(data: dict[str, Any] | None) -> dict[str, str]:
    """The styles, scripts and data in the page's head and foot, so that it works from one file; and the policy by which
    the browser fetches nothing and runs no other script.
    """
    style = (VENDORED / "uPlot.min.css").read_text(encoding="utf-8") + "\n"
    style += (TEMPLATES / "report.css").read_text(encoding="utf-8")
    code = [
        (VENDORED / "uPlot.iife.min.js").read_text(encoding="utf-8"),
        (TEMPLATES / "charts.js").read_text(encoding="utf-8"),
    ]
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(each.encode()).digest()).decode()}'" for each in code)
    rule = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {hashes}"
    # "</" would end the element that holds the data
    said = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/") if data is not None else ""
    return {"style": style, "uplot": code[0], "charts_js": code[1], "rule": rule, "data": said}


def render(facts: Facts) -> str:
    """The page as text."""
    recording, truth, result = facts.recording, facts.truth, facts.window.result
    css, headline, sentence = verdict(facts)
    data = chart_data(facts)
    order = facts.workcell.peg.shape().outline.symmetry_order
    true_hole = truth.pose_base_hole.pose() if truth else None
    colours = {times.phase: PHASE_COLOURS.get(times.phase, "#888888") for times in facts.times}
    return environment().get_template("page.html.j2").render(
        **scripts(data),
        facts=facts,
        file=recording.path.name,
        started=recording.metadata.get("recording", {}).get("started", "")[:19].replace("T", " "),
        seed=truth.seed if truth else None,
        result=result,
        verdict=css,
        headline=headline,
        sentence=sentence,
        how=how(facts),
        tiles=tiles(facts),
        stills=stills_of(facts),
        chart_ids=[chart["id"] for chart in data["charts"]],
        force_sets=next((chart["sets"] for chart in data["charts"] if chart["id"] == "force"), []),
        zooms=zooms(facts, data["phases"]),
        peaks=peak_rows(facts),
        touches=[touch_row(entry, true_hole, order) for entry in facts.touches],
        presses=[touch_row(entry, true_hole, order) for entry in facts.presses],
        pose_rows=pose_rows(facts),
        vision_pose=next((pose for pose in facts.poses if "(T1)" in pose.name), None),
        matrix=matrix_text,
        colours=colours,
        joints_end=degrees(facts.joints.at(facts.end_s)) if facts.joints is not None else [],
        tip_path=Quantity(facts.joints.tip_path_m(), "m", 3) if facts.joints is not None else None,
        configuration=yaml_text(facts),
        versions=recording.metadata.get("versions", {}),
        messages=sum(len(samples) for samples in recording.samples.values()),
    )  # fmt: skip


def zooms(facts: Facts, bands: list[dict[str, Any]]) -> list[tuple[str, float, float]]:
    """Buttons: (name, from, to), s; the whole assembly first, then every step that is long enough to look at."""
    found = [("all", round(facts.calibrated_s, 4), round(facts.end_s, 4))]
    repeated: dict[str, int] = {}
    for band in bands:
        if band["end"] <= facts.calibrated_s or band["end"] - band["start"] < 0.15:
            continue
        repeated[band["name"]] = repeated.get(band["name"], 0) + 1
        times = sum(1 for other in bands if other["name"] == band["name"] and other["end"] - other["start"] >= 0.15)
        name = f"{band['name']} {repeated[band['name']]}" if times > 1 else band["name"]
        found.append((name, band["start"], band["end"]))
    return found[:14]


def degrees(joints_rad: Array) -> list[str]:
    """For people."""
    return [number(float(each) * 180.0 / 3.141592653589793, 2) for each in joints_rad]


def yaml_text(facts: Facts) -> str:
    """The cell's file from the recording; empty where it was not recorded."""
    written = facts.recording.metadata.get("cell", {}).get("yaml", "")
    return written if written or not facts.configuration else yaml.safe_dump(facts.configuration)


def make_report(mcap_path: str | Path, html_path: str | Path) -> None:
    """Write the page about a recording. Raises RecordingError when the file is no recording, OSError for the page."""
    write(render(facts_of(read_recording(mcap_path))), html_path)


def write(page: str, html_path: str | Path) -> None:
    """Write a page and create its folder if needed. Raises OSError."""
    html_path = Path(html_path)
    html_path.parent.mkdir(parents=True, exist_ok=True)
    html_path.write_text(page, encoding="utf-8")


__all__ = ["make_report", "number", "render"]
