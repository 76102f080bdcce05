"""The tables of `crosspih bench states`."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

from services.operator.bench.contact_states.judged import CLASSIFIERS
from services.operator.bench.contact_states.labels import NONE


def _share(row: dict[str, Any]) -> str:
    if not row["of"]:
        return ""
    return f"{row['share']:.0%} ({row['low']:.0%}-{row['high']:.0%})"


def _stiffness(name: str) -> str:
    return "the cell's own" if name == "0" else f"{name} N/mm"


def print_tables(figures: dict[str, Any], console: Console) -> None:
    """By state, by count and stiffness, at random, confidence, and why the rule fails."""
    names = [classifier.value for classifier in CLASSIFIERS]
    table = Table(title=f"{figures['contacts']} contacts: share named right (95 % Wilson)")
    table.add_column("true state")
    table.add_column("contacts", justify="right")
    for name in names:
        table.add_column(name, justify="right")
    for state, row in figures["by_state"].items():
        shown = "none of the 26" if state == NONE else state
        last = state in ("1-2-4", "2-2-4", "3-2-4", "4-2-1")
        table.add_row(shown, str(row[names[0]]["of"]), *(_share(row[name]) for name in names), end_section=last)
    on_purpose = figures["on_purpose"]
    table.add_row("all on purpose", str(on_purpose[names[0]]["of"]), *(_share(on_purpose[name]) for name in names))
    means = figures["mean_over_states"]
    table.add_row("mean over the 26", "", *(f"{means[name]:.0%}" for name in names))
    console.print(table)

    table = Table(title="by arms that truly touch and stiffness at the rim, on purpose")
    for name in ("stiffness", "arms", "contacts", *names):
        table.add_column(name, justify="left" if name == "stiffness" else "right")
    for stiffness, counts in figures["by_stiffness"].items():
        for count, row in counts.items():
            of = row[names[0]]["of"]
            table.add_row(
                _stiffness(stiffness), count, str(of), *(_share(row[name]) for name in names), end_section=count == NONE
            )
    console.print(table)

    table = Table(title="pushes drawn at random: ±0.1 rad, ±5 mm")
    for name in ("stiffness", "made", *names):
        table.add_column(name)
    for stiffness, row in figures["random"].items():
        made = ", ".join(f"{count}: {number}" for count, number in sorted(row["made"].items()))
        table.add_row(_stiffness(stiffness), made, *(_share(row[name]) for name in names))
    console.print(table)

    table = Table(title="n_z0 by arms that truly touch")
    for name in ("arms", "5 %", "25 %", "median", "75 %", "95 %"):
        table.add_column(name, justify="right")
    for count, row in figures["n_z0"].items():
        table.add_row(count, *(f"{value:.3f}" for value in row.values()))
    console.print(table)

    table = Table(title="median of n_z0 by stiffness and arms that truly touch")
    table.add_column("stiffness")
    for count in figures["n_z0"]:
        table.add_column(count, justify="right")
    for stiffness, medians in figures["n_z0_median"].items():
        cells = (f"{medians[count]:.3f}" if count in medians else "" for count in figures["n_z0"])
        table.add_row(_stiffness(stiffness), *cells)
    console.print(table)

    table = Table(title="by the geometry, of 100 pushes anywhere within ±0.1 rad, ±5 mm, so many touch with")
    table.add_column("stiffness")
    for count in ("1 arm", "2", "3", "4", "none of the 26"):
        table.add_column(count, justify="right")
    for stiffness, shares in figures["by_geometry"].items():
        table.add_row(_stiffness(stiffness), *(f"{share * 100.0:.2f}" for share in shares))
    console.print(table)

    table = Table(title="why the rule does not name the true state")
    table.add_column("contacts", justify="right")
    table.add_column("why")
    for why, number in figures["rule_wrong"].items():
        table.add_row(str(number), why)
    console.print(table)
    errors = figures["calibration_error"]
    said = ", ".join(f"{name} {errors[name]:.3f}" for name in names)
    console.print(f"confidence off by, on average (expected calibration error): {said}", highlight=False)
    threes = figures["threes"]
    console.print(
        f"threes that the likelihood names wrong: {threes['wrong']}, of them as another three or the four of the same "
        f"sense {threes['another_three_or_four_of_the_same_sense']}",
        highlight=False,
    )
    none = ", ".join(f"{why} {number}" for why, number in figures["none_of_26"].items())
    console.print(f"none of the 26: {none}", highlight=False)
