"""`crosspih dataset show`: what is in a data set, and where it comes from."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.datasets import CONTACT, CONTACT_COLUMNS, ContactTable, read_contacts
from services.operator.bench.options import errors_shown


def summary(path: Path, table: ContactTable) -> Table:
    """Origin, counts by outcome and by state, and how large the errors and the forces are."""
    view = Table(title=f"{len(table)} samples in {path}", show_header=False)
    view.add_column("what")
    view.add_column("value", overflow="fold")
    origin = table.origin
    view.add_row("made by", f"{origin.made_by}: {origin.command}")
    view.add_row("cell", origin.cell_sha256[:16])
    view.add_row("code", origin.code or "not said")
    view.add_row("rows", table.sha256())
    outcomes = Counter(table.table["outcome"].to_pylist())
    touched = table.touched()
    poses = len(set(touched.integers("pose_seed").tolist()))
    view.add_row("contacts", f"{outcomes[CONTACT]} at {poses} poses")
    for outcome, count in sorted(outcomes.items()):
        if outcome != CONTACT:
            view.add_row("[yellow]no contact[/yellow]", f"{count}: {outcome}")
    states = Counter(touched.strings("state", "none").tolist())
    view.add_row("states", "  ".join(f"{name} {count}" for name, count in sorted(states.items())))
    if len(touched):
        angles = np.degrees(touched.numbers("angles_rad"))
        force = np.linalg.norm(touched.numbers("wrench")[:, :3], axis=1)
        view.add_row("error angles, sd", " / ".join(f"{value:.2f}°" for value in angles.std(axis=0)))
        view.add_row("force, p5 to p95", " to ".join(f"{value:.1f} N" for value in np.percentile(force, [5, 95])))
    return view


def describe(
    data: Annotated[Path, typer.Argument(help="A data set's folder.")] = Path("run/contacts"),
    columns: Annotated[bool, typer.Option("--columns", help="What the columns mean.")] = False,
) -> None:
    """Print what is in a data set of contacts."""
    with errors_shown(Console(stderr=True)):
        Console().print(summary(data, read_contacts(data)))
    if columns:
        view = Table("column", "type", "what")
        for name, (length, kind, doc) in CONTACT_COLUMNS.items():
            view.add_row(name, kind if length is None else f"{length} x {kind}", doc)
        Console().print(view)
