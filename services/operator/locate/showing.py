"""Prints the result of `crosspih locate` for people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosspih_common.geometry import Pose


def show(console: Console, answer: dict[str, Any], annotated: Path | None, place: str) -> None:
    """Print the pose with its standard deviations and the figures behind it, or why there is none. `place` names the
    source of the left camera's pose in the base.
    """
    if answer["located"]:
        _pose(console, answer)
    else:
        refusal = answer["refusal"]
        console.print(f"[red]refused[/red] {refusal['code']}: {escape(refusal['text'])}", highlight=False)
    for warning in answer["warnings"]:
        console.print(f"[yellow]warning[/yellow] {escape(warning)}", highlight=False, soft_wrap=True)
    figures = {name: value for name, value in answer.get("quality", {}).items() if value is not None}
    if figures:
        told = ", ".join(f"{name} {value:.3g}" for name, value in figures.items())
        console.print(f"quality: {told}", highlight=False, markup=False)
    console.print(f"{answer['time_s'] * 1e3:.0f} ms; {place}", highlight=False, markup=False)
    if annotated is not None:
        console.print(f"pictures: {annotated / 'left.png'}, {annotated / 'right.png'}", highlight=False, markup=False)


def _pose(console: Console, answer: dict[str, Any]) -> None:
    pose = Pose.from_matrix(answer["pose_base_hole"])
    sd = np.sqrt(np.diag(np.asarray(answer["covariance"], float)))
    table = Table(title="the hole in the base frame; its origin is the rim's centre, its z goes into the hole")
    for name in ("", "x", "y", "z"):
        table.add_column(name, justify="right" if name else "left")
    rows = (
        ("position, mm", pose.translation_m * 1e3, 3),
        ("one sd along the hole's axis, mm", sd[:3] * 1e3, 3),
        ("rotation vector, °", np.degrees(pose.rotvec_rad()), 3),
        ("one sd about the hole's axis, °", np.degrees(sd[3:]), 3),
    )
    for name, values, digits in rows:
        table.add_row(name, *(f"{value:.{digits}f}" for value in values))
    console.print(table)
