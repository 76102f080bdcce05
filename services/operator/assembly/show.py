"""The printed messages while an assembly runs, and the summary at its end."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from crosspih_common.messages import AssemblyPhase, Event, Phase, Severity, Touch
from services.operator.scoring.score import TrialFigures, seen_in_words

COLOURS = {
    Phase.CALIBRATING: "blue",
    Phase.LOCATING: "magenta",
    Phase.APPROACHING: "cyan",
    Phase.PUSHING: "yellow",
    Phase.TOUCHING: "yellow",
    Phase.ESTIMATING: "green",
    Phase.CORRECTING: "cyan",
    Phase.SEATED: "bold green",
    Phase.BACKING_OFF: "red",
    Phase.DONE: "bold",
}
UNITS = ("mm", "deg", "n", "nm", "s")


class Story:
    """Prints each phase as it happens, with the cell's time in front."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._start_ns: int | None = None
        self.telling = False

    def begin(self, now_ns: int) -> None:
        """Start printing; messages from before this time that arrive late are ignored."""
        self._start_ns, self.telling = now_ns, True

    def checking(self, step: str) -> None:
        """A step of the first check of a cell, before the assembly begins."""
        self._console.print(f"[dim]first check of this cell: {escape(step)}[/dim]", highlight=False)

    def phase(self, phase: AssemblyPhase) -> None:
        """One step."""
        if not self.telling or self._start_ns is None or phase.stamp_ns <= self._start_ns:
            return
        seconds = (phase.stamp_ns - self._start_ns) * 1e-9
        colour = COLOURS.get(phase.phase, "white")
        figures = ", ".join(f"{_name(name)} {value:.3g}{_unit(name)}" for name, value in phase.figures.items())
        line = f"[dim]{seconds:7.2f} s[/dim]  [{colour}]{phase.phase.value:<12}[/{colour}] {phase.text}"
        self._console.print(line + (f"  [dim]{figures}[/dim]" if figures else ""), highlight=False, soft_wrap=True)

    def touch(self, touch: Touch) -> None:
        """The wrench of a touch."""
        if self.telling:
            fx, fy, fz, mx, my, mz = touch.wrench
            self._console.print(
                f"[dim]{'':10}  {'':12} F ({fx:+.2f}, {fy:+.2f}, {fz:+.2f}) N  "
                f"M ({mx:+.3f}, {my:+.3f}, {mz:+.3f}) Nm[/dim]",
                highlight=False,
                soft_wrap=True,
            )

    def event(self, event: Event) -> None:
        """Warnings and errors of any service."""
        if self.telling and event.severity is not Severity.INFO:
            self._console.print(f"[red]{event.service}: {event.code}: {event.text}[/red]", highlight=False)


def directions_held(rank: int) -> str:
    """In words, how much of the pose the walls of the bore fix: the rank of their constraints, 5 at most."""
    return f"{rank} of 5" + ("" if rank == 5 else "; how a round is turned about its axis nothing tells")


def _unit(name: str) -> str:
    tail = name.rsplit("_", 1)[-1]
    return {"mm": " mm", "deg": "°", "n": " N", "nm": " Nm", "s": " s"}.get(tail, "") if tail in UNITS else ""


def _name(name: str) -> str:
    head, _, tail = name.rpartition("_")
    return (head if tail in UNITS and head else name).replace("_", " ")


def summary(figures: TrialFigures) -> Table:
    """The end of an assembly, one figure a line."""
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()

    def row(name: str, text: str) -> None:
        table.add_row(name, Text.from_markup(text, overflow="fold"))

    verdict = "[bold green]inserted[/bold green]" if figures.inserted else f"[bold red]{figures.failure}[/bold red]"
    row("result", verdict + (f"  {figures.failure_detail}" if figures.failure_detail else ""))
    if figures.insertion_depth_mm is not None:
        row("depth of the body in its bore", f"{figures.insertion_depth_mm:.1f} mm")
    row(
        "duration",
        f"{figures.duration_s:.1f} s = {figures.motion_s:.1f} s motion + {figures.thinking_s:.1f} s thinking",
    )
    row("touches, corrections, pushes", f"{figures.touches}, {figures.corrections}, {figures.pushes}")
    row("peak force and moment", f"{figures.peak_force_n:.1f} N, {figures.peak_moment_nm:.2f} Nm")
    if figures.vision_refused or figures.felt_for:
        row("vision", f"[yellow]{escape(seen_in_words(figures))}[/yellow]")
    if figures.vision_error_mm is not None:
        row(
            "vision against the truth",
            f"{figures.vision_error_mm:.3f} mm lateral, {figures.vision_error_deg:.2f}° "
            f"(depth {figures.vision_depth_mm:+.2f} mm)",
        )
    if figures.final_error_mm is not None:
        row(
            "found pose T2 against the truth",
            f"{figures.final_error_mm:.3f} mm lateral, {figures.final_error_deg:.2f}°",
        )
    if figures.rank is not None:
        row("directions the walls hold", directions_held(figures.rank))
    for warning in figures.warnings:
        row("[bold yellow]warning[/bold yellow]", f"[yellow]{escape(warning)}[/yellow]")
    for warning in figures.recording_warnings:
        row("[bold yellow]recording[/bold yellow]", f"[yellow]{escape(warning)}[/yellow]")
    for number, part in enumerate(figures.recording_parts or ((figures.recording,) if figures.recording else ())):
        row("recording" if number == 0 else f"part {number + 1} of it", _near(part))
    if figures.report:
        row("report", _near(figures.report))
    return table


def _near(path: str) -> str:
    """The shortest form of a path as seen from the current folder."""
    try:
        return str(Path(path).relative_to(Path.cwd()))
    except ValueError:
        return path


def pose_lines(title: str, matrix: list[list[float]]) -> str:
    """A 4 x 4 pose as the paper prints it."""
    rows = ["  ".join(f"{value:+.4f}" for value in line) for line in matrix[:3]]
    return "\n".join([title, *(f"  [ {row} ]" for row in rows)])
