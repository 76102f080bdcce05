"""The texts and small tables of the page, as HTML. All that came from the bus is escaped."""

from __future__ import annotations

from html import escape

import numpy as np

from crosspih_common.messages import Phase, ServiceState, Severity
from services.viewer.charts import GROUP_OF, GROUPS, TOUCH_COLOUR
from services.viewer.section_picture import words_of
from services.viewer.timeline import SceneMoment

STYLE = """<style>
.cp{padding:0 12px 6px;font-size:13px;line-height:1.45;color:var(--mantine-color-text)}
.cp .dim{color:var(--mantine-color-dimmed)} .cp b{font-weight:650}
.cp table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
.cp td,.cp th{padding:1px 6px 1px 0;text-align:left;vertical-align:top;font-weight:400}
.cp td.n,.cp th.n{text-align:right;padding-right:0}
.cp .chip{display:inline-block;border-radius:9px;padding:1px 9px;color:#fff;font-weight:650}
.cp .dot{display:inline-block;width:9px;height:9px;border-radius:50%;margin-right:6px}
.cp .key{display:inline-block;white-space:nowrap;margin-right:9px}
.cp .key i{display:inline-block;width:10px;height:10px;border-radius:2px;margin-right:4px;vertical-align:-1px}
.cp .note{border-left:3px solid #fab005;padding-left:8px;margin:3px 0;overflow-wrap:anywhere}
.cp .bad{border-left-color:#fa5252} .cp .good{border-left-color:#40c057}
.u-legend .shade{display:none} .uplot-container .u-legend{font-size:12px}
</style>"""
STATE_COLOUR = {
    ServiceState.READY: "#40c057",
    ServiceState.ACTIVE: "#228be6",
    ServiceState.STARTING: "#fab005",
    ServiceState.STOPPING: "#fab005",
    ServiceState.FAILED: "#fa5252",
}
SILENT_NS = 4 * 10**9  # a service without a status for this long counts as silent


def colour_of(phase: Phase | None) -> str:
    """The colour of a phase's chip and of its shade in the charts."""
    group = None if phase is None else GROUP_OF.get(phase)
    return "#868e96" if group is None else GROUPS[group][1]


def headline(moment: SceneMoment) -> str:
    """The phase, its text, its duration, and how the assembly ended."""
    if moment.phase is None:
        idle = '<span class="chip" style="background:#868e96">idle</span> <span class="dim">no assembly yet</span>'
        return _block(idle)
    phase, result = moment.phase, moment.result
    took_s = (moment.stamp_ns - moment.trial_ns) * 1e-9
    chip, said = phase.phase.value.replace("_", " "), escape(phase.text)
    colour = colour_of(phase.phase)
    lines = []
    if result is not None and result.stamp_ns <= moment.stamp_ns:
        took_s = (result.stamp_ns - moment.trial_ns) * 1e-9
        failed = "" if result.failure is None else result.failure.value.replace("_", " ")
        chip = "inserted" if result.inserted else f"not inserted: {failed}"
        colour = "#2f9e44" if result.inserted else "#e03131"
        said = escape(result.failure_detail) if not result.inserted else f"{result.insertion_depth_m * 1e3:.1f} mm deep"
        lines.append(
            f'<div class="dim">peak {result.peak_force_n:.1f} N, {result.peak_moment_nm:.2f} Nm; '
            f"touches {result.touches}, corrections {result.corrections}, pushes {result.pushes}</div>"
        )
        lines += [f'<div class="note">{escape(text)}</div>' for text in result.warnings]
    if moment.withdrawn is not None and (result is None or moment.withdrawn.stamp_ns > result.stamp_ns):
        out = moment.withdrawn
        chip, colour = ("withdrawn", "#2f9e44") if out.withdrawn else ("not withdrawn", "#e03131")
        said = f"{out.distance_m * 1e3:.0f} mm out" if out.withdrawn else escape(out.failure_detail)
    first = (
        f'<div><span class="chip" style="background:{colour}">{escape(chip)}</span> '
        f'<span style="float:right" class="dim">{max(took_s, 0.0):.1f} s</span></div><div>{said}</div>'
    )
    return _block(first + "".join(lines))


def shades(moment: SceneMoment) -> str:
    """The legend of the colours behind the charts: the phases so far."""
    groups = sorted({GROUP_OF[span.phase] for span in moment.spans if span.phase in GROUP_OF})
    keys = [f'<span class="key"><i style="background:{GROUPS[one][1]}"></i>{GROUPS[one][0]}</span>' for one in groups]
    count = sum(not touch.seated for touch in moment.touches)
    mark = f'<i style="background:{TOUCH_COLOUR};width:3px"></i>'
    touches = f'<span class="key">{mark}{count} touch{"es" * (count > 1)}</span>' if count else ""
    return _block("".join(keys) + touches) if keys else _block('<span class="dim">phases appear here</span>')


def contact(moment: SceneMoment) -> str:
    """The contact state and the wrench in words."""
    lines = [f"<div>{escape(words_of(moment.contact if moment.in_contact else None))}</div>"]
    if not moment.in_contact:
        lines = ['<div class="dim">free: nothing touches</div>']
    if moment.wrench is not None:
        force, torque = moment.wrench[:3], moment.wrench[3:]
        rows = "".join(
            f'<tr><td class="dim">{name}</td>'
            + "".join(f'<td class="n">{value:+.{digits}f}</td>' for value in values)
            + f'<td class="n"><b>{np.linalg.norm(values):.{digits}f}</b> {unit}</td></tr>'
            for name, values, digits, unit in (("F", force, 2, "N"), ("M", torque, 3, "Nm"))
        )
        head = '<tr><th></th><th class="n">x</th><th class="n">y</th><th class="n">z</th><th class="n">size</th></tr>'
        lines.append(f'<table><thead class="dim">{head}</thead>{rows}</table>')
    return _block("".join(lines))


def estimate(moment: SceneMoment) -> str:
    """Where the hole is believed to be, the source of the estimate, and its uncertainty."""
    belief = moment.belief
    if belief is None:
        return _block('<span class="dim">hole: as drawn; nothing has measured it</span>')
    x, y, z = (value * 1e3 for value in belief.pose_base_hole.position_m)
    said = f"<div>hole by <b>{escape(belief.by)}</b>: ({x:.1f}, {y:.1f}, {z:.1f}) mm</div>"
    if belief.covariance is not None:
        sds = np.sqrt(np.maximum(np.diag(np.asarray(belief.covariance).reshape(6, 6)), 0.0))
        lateral, depth, tilt = float(np.hypot(*sds[:2])), float(sds[2]), float(np.hypot(*sds[3:5]))
        said += (
            f'<div class="dim">sd across {lateral * 1e3:.3f} mm, depth {depth * 1e3:.3f} mm, tilt '
            f"{np.degrees(tilt):.2f}°, turn {np.degrees(float(sds[5])):.2f}°</div>"
        )
    return _block(said)


def services(moment: SceneMoment, alive: frozenset[str] | None = None) -> str:
    """Each service: its state, rates of what it sends and receives, losses, and its last error.

    `alive` are the running ones; where that is not known, a service without a recent status counts as silent.
    """
    if not moment.services:
        return _block('<span class="dim">no service has told how it is</span>')
    rows = []
    for one in moment.services:
        silent = moment.stamp_ns - one.stamp_ns > SILENT_NS if alive is None else one.service not in alive
        colour = "#868e96" if silent else STATE_COLOUR[one.state]
        state = ("silent" if alive is None else "gone") if silent else one.state.value
        out, heard = (sum(getattr(key, way) for key in one.traffic) for way in ("out_hz", "in_hz"))
        lost = f'<td class="n">{one.dropped + one.rejected or ""}</td>'
        rows.append(
            f'<tr><td><span class="dot" style="background:{colour}"></span>{escape(one.service)}</td>'
            f'<td class="dim">{state}</td><td class="n">{out:.0f}</td><td class="n">{heard:.0f}</td>{lost}</tr>'
        )
        if text := one.reason or one.last_error:
            rows.append(f'<tr><td colspan="5" class="dim" style="padding-left:15px">{escape(text[:160])}</td></tr>')
    head = '<tr><th></th><th></th><th class="n">sends/s</th><th class="n">hears/s</th><th class="n">lost</th></tr>'
    return _block(f'<table><thead class="dim">{head}</thead>{"".join(rows)}</table>')


def holder(moment: SceneMoment) -> str:
    """Who holds the arm."""
    lease = moment.lease
    if lease is None or not lease.holder:
        lost = "" if lease is None or not lease.lost_holder else f"; {escape(lease.lost_holder)} had it and was lost"
        return f"arm: free{lost}"
    return f"arm: held by <b>{escape(lease.holder)}</b> {escape(lease.purpose)}"


def warnings(moment: SceneMoment) -> str:
    """The newest warnings and errors of this assembly."""
    told = [event for event in moment.events if event.severity is not Severity.INFO][-3:]
    if not told:
        return ""
    return _block("".join(
        f'<div class="note{" bad" * (event.severity is Severity.ERROR)}"><b>{escape(event.service)}</b> '
        f"{escape(event.text[:240])}</div>"
        for event in told
    ))  # fmt: skip


def _block(inside: str) -> str:
    return f'<div class="cp">{inside}</div>'


def themes() -> str:
    """Links that choose the page's colours; each loads the page anew."""
    links = " · ".join(f'<a href="?theme={name}">{name}</a>' for name in ("light", "dark", "auto"))
    return _block(f'<span class="dim">colours: {links}</span>')
