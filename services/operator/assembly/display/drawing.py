"""The state of an assembly as a panel in a terminal. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from crosspih_common.messages import Phase
from services.operator.assembly.display.standing import BUCKET_S, HISTORY_S, ORDER, AssemblyStanding

BLOCKS = " ▁▂▃▄▅▆▇█"
BAR_CELLS = 24
MIN_SCALE = 0.1  # share of the cap: the full scale of a history in which less was measured
NEAR_CAP, WARM_CAP = 0.85, 0.5
ONE_LINE_COLUMNS = 140  # all phases with their times
MIN_CELLS = 8  # a shorter history shows nothing useful
FIXED_COLUMNS = 78  # width of the text before a history


def sparkline(values: list[float], largest: float) -> str:
    """One character a value, from blank at 0 to a full block at `largest` and above."""
    if largest <= 0.0:
        return BLOCKS[0] * len(values)
    steps = len(BLOCKS) - 1
    return "".join(BLOCKS[min(round(max(value, 0.0) / largest * steps), steps)] for value in values)


def narrowed(values: list[float], cells: int) -> list[float]:
    """The same values in at most this many, each the largest of those that it stands for."""
    if cells >= len(values):
        return values
    size = -(-len(values) // cells)
    return [max(values[start : start + size]) for start in range(0, len(values), size)]


def _bar(value: float, cap: float, peak: float) -> Text:
    """A bar filled up to the value, with a mark at the peak; its full width is the cap."""
    filled = min(round(value / cap * BAR_CELLS), BAR_CELLS)
    mark = min(round(peak / cap * BAR_CELLS), BAR_CELLS - 1)
    style = "red" if value > NEAR_CAP * cap else "yellow" if value > WARM_CAP * cap else "green"
    bar = Text("▕")
    for cell in range(BAR_CELLS):
        if cell < filled:
            bar.append("█", style)
        elif cell == mark and peak > 0.0:
            bar.append("│", "bold")
        else:
            bar.append("·", "dim")
    return bar.append("▏")


def _load_row(
    table: Table, name: str, value: float, cap: float, peak: float, unit: str, history: list[float], cells: int
) -> None:
    scale = max(*history, MIN_SCALE * cap)
    digits = 1 if unit == "N" else 2
    said = Text.assemble(
        (f"{value:6.{digits}f} {unit:<2} ", ""), _bar(value, cap, peak), (f" cap {cap:g} {unit}", "dim"),
        (f"  largest {peak:.{digits}f}", ""),
    )  # fmt: skip
    if cells >= MIN_CELLS:
        line = Text(sparkline(narrowed(history, cells), scale), "cyan")
        said.append("  ").append_text(line).append(f" {scale:.{digits}f}", "dim")
    table.add_row(name, said)


def _phases(standing: AssemblyStanding, width: int) -> Text:
    """All phases with their times, always in the same number of lines, so that nothing below them jumps."""
    lines = 1 if width >= ONE_LINE_COLUMNS else 2
    size = -(-len(ORDER) // lines)
    text = Text("\n", no_wrap=True, overflow="ellipsis").join(
        [_some_phases(standing, ORDER[start : start + size]) for start in range(0, len(ORDER), size)]
    )
    for phase in (Phase.BACKING_OFF, Phase.DONE):
        if phase is standing.phase:
            text.append(phase.value, "bold red" if phase is Phase.BACKING_OFF else "bold green")
    return text


def _some_phases(standing: AssemblyStanding, phases: Sequence[Phase]) -> Text:
    text = Text()
    for phase in phases:
        spent_s = standing.in_phase_s(phase)
        if phase is standing.phase:
            text.append(f" {phase.value} {spent_s or 0.0:.1f} s ", "bold reverse")
        elif spent_s is None:
            text.append(phase.value, "dim")
        else:
            text.append(f"{phase.value} {spent_s:.1f} s", "green")
        text.append("   ")
    return text


def _believed(standing: AssemblyStanding) -> Text:
    found = standing.believed
    if found is None:
        return Text("not known yet", "dim")
    where = ""
    if found.position_mm:
        where = "({:.2f}, {:.2f}, {:.2f}) mm, ".format(*found.position_mm)
    return Text.assemble(
        where,
        f"sd {found.sd_lateral_mm:.3f} mm across, {found.sd_depth_mm:.3f} mm along, {found.sd_tilt_deg:.2f}°",
        (f"  by {found.by}", "dim"),
    )


def drawn(standing: AssemblyStanding, width: int) -> RenderableType:
    """The panel, for a terminal of this many columns."""
    table = Table(box=None, show_header=False, pad_edge=False, expand=True)
    table.add_column(style="dim", no_wrap=True, width=8)
    table.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
    cells = max(min(width - FIXED_COLUMNS - 12, round(HISTORY_S / BUCKET_S)), 0)
    force_n, moment_nm = (sum(value**2 for value in part) ** 0.5 for part in (standing.wrench[:3], standing.wrench[3:]))
    loads = (
        ("force", force_n, standing.caps.force_n, standing.peak_n, "N", standing.history()),
        ("moment", moment_nm, standing.caps.moment_nm, standing.peak_nm, "Nm", standing.history(moments=True)),
    )
    for name, value, cap, peak, unit, history in loads:
        if standing.felt:
            _load_row(table, name, value, cap, peak, unit, history, cells)
        else:
            table.add_row(name, Text("nothing heard from the sensor yet", "dim"))
    fx, fy, fz, mx, my, mz = standing.wrench
    table.add_row(
        "parts", Text(f"F ({fx:+.2f}, {fy:+.2f}, {fz:+.2f}) N  M ({mx:+.3f}, {my:+.3f}, {mz:+.3f}) Nm", "dim")
    )
    pressed = f", presses against walls {standing.presses}" if standing.presses else ""
    counts = f"touches {standing.touches}, corrections {standing.corrections}, pushes {standing.pushes}{pressed}"
    table.add_row("so far", counts)
    table.add_row("hole", _believed(standing))
    for event in standing.events:
        table.add_row("warned", Text(event, "red"))
    body = Group(_phases(standing, width), Text(standing.text, "bold", no_wrap=True, overflow="ellipsis"), table)
    told = f"forces smoothed   {standing.now_s:.1f} s of the cell's time"
    return Panel(
        body, title=standing.title, title_align="left", subtitle=told, subtitle_align="right", border_style="dim"
    )
