"""Forces and moments against time as columns of a chart, with phases and touches: the paper's Figure 19."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Phase
from services.viewer.series import decimated
from services.viewer.timeline import PhaseSpan, SceneMoment

BUCKETS = 180
MARK_SHARE = 0.003  # width of a touch as a share of the chart's
GROUPS: tuple[tuple[str, str, tuple[Phase, ...]], ...] = (
    ("calibrate", "#868e96", (Phase.CALIBRATING,)),
    ("look", "#15aabf", (Phase.LOCATING,)),
    ("approach", "#4c6ef5", (Phase.APPROACHING,)),
    ("push", "#40c057", (Phase.PUSHING,)),
    ("touch", "#fab005", (Phase.TOUCHING,)),
    ("estimate, correct", "#be4bdb", (Phase.ESTIMATING, Phase.CORRECTING)),
    ("seated", "#12b886", (Phase.SEATED,)),
    ("back off", "#fa5252", (Phase.BACKING_OFF,)),
)
"""Phases that are shaded alike: a name, a colour, and which they are."""
TOUCH_COLOUR = "#f08c00"
GROUP_OF = {phase: index for index, (_, _, phases) in enumerate(GROUPS) for phase in phases}


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """Columns over one axis: times (n,), s; `shades` (groups + 2, n), which are 1 during such a phase, at a touch, and
    at the moment shown, and else 0; forces (3, n), N; moments (3, n), Nm.
    """

    times_s: Array
    shades: Array
    forces_n: Array
    moments_nm: Array


def chart_of(moment: SceneMoment, times_s: Array, wrenches: Array, now_s: float | None = None) -> Chart:
    """The chart of wrenches (k, 6), N and Nm, at times (k,), s since the trial of `moment` began.

    `now_s` marks a moment, such as the one of a recording that is shown.
    """
    base, values = decimated(times_s, wrenches, BUCKETS)
    wide_s = MARK_SHARE * max(float(base[-1]) if len(base) else 0.0, 1.0)
    marks = [[(touch.stamp_ns - moment.trial_ns) * 1e-9 for touch in moment.touches if not touch.seated]]
    marks.append([] if now_s is None else [now_s])
    upright = [at + step for one in marks for at in one for step in (-1e-4, 0.0, wide_s, wide_s + 1e-4)]
    times = np.unique(np.concatenate([base, _edges(moment.spans, moment.trial_ns), upright, [0.0]]))
    columns = np.zeros((len(times), 6))
    if len(base):
        columns = np.column_stack([np.interp(times, base, column) for column in values.T])
    shades = [_shades(moment.spans, moment.trial_ns, times)]
    for one in marks:
        since = times - np.reshape(one, (-1, 1))
        shades.append(np.any((since >= 0.0) & (since <= wide_s), axis=0, keepdims=True).astype(float))
    return Chart(times, np.vstack(shades), columns[:, :3].T, columns[:, 3:].T)


def _edges(spans: Sequence[PhaseSpan], first_ns: int) -> Array:
    """Times just before and at each change of phase, so that each shade has vertical edges."""
    found = []
    for span in spans:
        for stamp in (span.from_ns, span.until_ns):
            at = (stamp - first_ns) * 1e-9
            found += [at - 1e-4, at]
    return np.array([at for at in found if at >= 0.0])


def _shades(spans: Sequence[PhaseSpan], first_ns: int, times_s: Array) -> Array:
    shades = np.zeros((len(GROUPS), len(times_s)))
    for span in spans:
        if (group := GROUP_OF.get(span.phase)) is not None:
            low, high = ((stamp - first_ns) * 1e-9 for stamp in (span.from_ns, span.until_ns))
            shades[group, (times_s >= low - 1e-9) & (times_s < high - 1e-9)] = 1.0
    return shades
