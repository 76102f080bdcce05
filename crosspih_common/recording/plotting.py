"""An assembly's contact forces and moments against time, phases and touches marked: the paper's Figure 19."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from crosspih_common.errors import ConfigError
from crosspih_common.keys import ASSEMBLE, CONTACT_WRENCH, PHASE, TOUCH
from crosspih_common.messages import Phase

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from crosspih_common.recording.reader import Recording

LINES = ("#c44e52", "#2f9e6e", "#4a7fd6")  # x, y, z
PHASE_COLOURS = {
    Phase.CALIBRATING: "#8a8d93",
    Phase.LOCATING: "#b07cc6",
    Phase.APPROACHING: "#5b9bd5",
    Phase.PUSHING: "#e0a03c",
    Phase.TOUCHING: "#d96c5f",
    Phase.ESTIMATING: "#c66ba0",
    Phase.CORRECTING: "#45a3a3",
    Phase.SEATED: "#5fae57",
    Phase.BACKING_OFF: "#a0522d",
    Phase.DONE: "#6f9f3f",
}
MATPLOTLIB = "matplotlib is not installed, and a plot needs it: pip install 'crosspih[client]'"


def window_ns(recording: Recording) -> tuple[int, int]:
    """(begin, end) of the last assembly in cell time, ns: from the command to its answer, or what is recorded of it."""
    first, last = recording.span_ns()
    result = recording.result()
    end = last if result is None else result.stamp_ns
    begun = [sent.value.stamp_ns for sent in recording.sent(ASSEMBLE.request_echo) if sent.value.stamp_ns <= end]
    phases = [phase.stamp_ns for phase in recording.messages(PHASE) if phase.stamp_ns <= end]
    return (begun[-1] if begun else phases[0] if phases else first), end


def figure_of(recording: Recording) -> Figure:
    """The figure. Raises ConfigError without matplotlib, and where no wrench is recorded."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        raise ConfigError(MATPLOTLIB) from None
    begin, end = window_ns(recording)
    samples = [sample for sample in recording.messages(CONTACT_WRENCH) if begin <= sample.stamp_ns <= end]
    if not samples:
        raise ConfigError(f"{recording.path}: no contact wrench of an assembly is in it: nothing to draw")
    time_s = np.array([(sample.stamp_ns - begin) * 1e-9 for sample in samples])
    wrench = np.array([sample.wrench for sample in samples])
    end_s = (end - begin) * 1e-9
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    force, moment = figure.subplots(2, 1, sharex=True)
    phases = [phase for phase in recording.messages(PHASE) if begin <= phase.stamp_ns <= end]
    spans = [
        (phase.phase, (phase.stamp_ns - begin) * 1e-9, (after - begin) * 1e-9)
        for phase, after in zip(phases, [*(phase.stamp_ns for phase in phases[1:]), end], strict=True)
    ]
    for axes, first, symbol, label in ((force, 0, "F", "contact force / N"), (moment, 3, "M", "contact moment / Nm")):
        for offset, axis in enumerate("xyz"):
            axes.plot(time_s, wrench[:, first + offset], color=LINES[offset], linewidth=1.0, label=f"{symbol}{axis}")
        axes.axhline(0.0, color="0.5", linewidth=0.5)
        axes.set_ylabel(label)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="upper left", ncols=3, frameon=False)
        _mark(axes, spans)
        for number, touch in enumerate(recording.messages(TOUCH), 1):
            if begin <= touch.stamp_ns <= end:
                at_s = (touch.stamp_ns - begin) * 1e-9
                axes.axvline(at_s, color="0.2", linewidth=0.8, linestyle=":")
                if axes is force:
                    axes.annotate(
                        str(number), (at_s, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom"
                    )
    _name_phases(moment, spans)
    moment.set_xlim(0.0, max(end_s, 1e-3))
    moment.set_xlabel("cell time since the command / s")
    result = recording.result()
    if result is not None:
        figure.suptitle(f"{result.assembly_id}: {'inserted' if result.inserted else result.failure.value}")  # type: ignore[union-attr]
    return figure


def _mark(axes: Axes, spans: list[tuple[Phase, float, float]]) -> None:
    for phase, start_s, stop_s in spans:
        if stop_s > start_s:
            axes.axvspan(start_s, stop_s, color=PHASE_COLOURS.get(phase, "#888888"), alpha=0.15, linewidth=0)


def _name_phases(axes: Axes, spans: list[tuple[Phase, float, float]]) -> None:
    """A legend of the phases that last long enough to be seen."""
    from matplotlib.patches import Patch

    seen: dict[Phase, Any] = {}
    for phase, start_s, stop_s in spans:
        if stop_s > start_s and phase not in seen:
            seen[phase] = Patch(color=PHASE_COLOURS.get(phase, "#888888"), alpha=0.3, label=phase.value)
    if seen:
        lines = axes.get_legend()
        axes.legend(handles=list(seen.values()), loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=8, frameon=False)
        if lines is not None:
            axes.add_artist(lines)
