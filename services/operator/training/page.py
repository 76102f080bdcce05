"""The HTML page about a training: fills the template with the words and numbers of a result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from services.operator.report.page import number
from services.operator.training.figures import curve_figure, error_figure, sample_figure, scatter_figure

SAMPLES_SHOWN = 40
PARTS = ("training", "validation", "test")


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    return environment


def _table_page(result: dict[str, Any]) -> dict[str, Any]:
    """The content of the page of a training on a data set."""
    parts, record = result["parts"], result["record"]
    test = parts["test"]
    groups = [("guessing the mean", test["mean"]["rms_deg"])]
    groups.append(("nearest training contacts", test["nearest_training_contacts"]["rms_deg"]))
    groups.append(("the network", test["network"]["rms_deg"]))
    if result["floor"] is not None:
        groups.append(("floor, from the mechanics", result["floor"]["rms_deg"]))
    shown = np.linspace(0, len(test["true_deg"]) - 1, min(SAMPLES_SHOWN, len(test["true_deg"]))).astype(int)
    true, said = np.array(test["true_deg"])[shown], np.array(test["predicted_deg"])[shown]
    limit = float(np.ceil(np.abs(test["true_deg"]).max()) + 1.0)
    best = max(
        range(3), key=lambda index: test["mean"]["rms_deg"][index] / max(test["network"]["rms_deg"][index], 1e-9)
    )
    rms, mean = test["network"]["rms_deg"], test["mean"]["rms_deg"]
    within = test["network"]["within_1_deg"]
    return {
        "headline": f"{number(rms[0])}° / {number(rms[1])}° / {number(rms[2])}° on contacts it has never seen",
        "sentence": (
            f"RMS error of α, β, γ on the test poses; guessing the mean gives {number(mean[0])}° / "
            f"{number(mean[1])}° / {number(mean[2])}°. It tells {('α', 'β', 'γ')[best]} best. "
            f"Within 1°, as the paper claims, are {within[0] * 100:.0f} % / {within[1] * 100:.0f} % / "
            f"{within[2] * 100:.0f} % of the test contacts."
        ),
        "groups": groups,
        "error_svg": error_figure(groups),
        "sample_svg": sample_figure(true, said, "network"),
        "samples_shown": len(shown),
        "scatter_svg": scatter_figure(test["true_deg"], test["predicted_deg"], limit),
        "curve_svg": curve_figure(result["curves"], record["goal"]),
        "parts": [(name, parts[name]) for name in PARTS],
    }


def _rows_page(result: dict[str, Any]) -> dict[str, Any]:
    """The content of the page of the ten printed rows."""
    inside, left = result["in_sample"], result["leave_one_out"]
    groups = [
        ("in the sample", inside["rms_deg"]),
        ("each by the nine others", left["rms_deg"]),
        ("mean of the nine others", result["mean_of_the_others"]["rms_deg"]),
    ]
    largest = max(inside["max_deg"])
    return {
        "headline": f"Largest error {number(largest)}° in the sample, {number(max(left['max_deg']))}° out of it",
        "sentence": (
            "The paper says that its errors are within 1°. On the ten rows that it prints this "
            + ("holds" if largest <= 1.0 else "does not hold")
            + " for a network that was trained on them. A row that the network has not seen is another matter."
        ),
        "groups": groups,
        "error_svg": error_figure(groups),
        "sample_svg": sample_figure(
            result["true_deg"], result["in_sample_deg"], "in the sample",
            [("each by the nine others", result["leave_one_out_deg"])],
        ),
        "samples_shown": len(result["true_deg"]),
        "scatter_svg": scatter_figure(result["true_deg"], result["leave_one_out_deg"], 8.0),
        "curve_svg": curve_figure(result["curves"], result["record"]["goal"]),
        "parts": [],
    }  # fmt: skip


def render_training(result: dict[str, Any]) -> str:
    """The page as text, from the output of the training process."""
    rows = "leave_one_out" in result
    shown = _rows_page(result) if rows else _table_page(result)
    template = _environment().get_template("page.html.j2")
    return template.render(result=result, rows=rows, angles=("α", "β", "γ"), **shown)


def write_training_report(result: dict[str, Any], path: Path) -> None:
    """Write the page; its folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(render_training(result), encoding="utf-8")
