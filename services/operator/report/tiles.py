"""The figures at the top of a report; each is one of the facts, and is repeated in a table below."""

from __future__ import annotations

from dataclasses import dataclass

from services.operator.report.model import Facts
from services.operator.report.numbers import Quantity, number
from services.operator.report.words import counted

PAPER_DURATION_S = 27  # the paper's one experiment, for comparison


@dataclass(frozen=True, slots=True)
class Tile:
    """One figure: its name, its number, and a note in words and numbers (`also`)."""

    name: str
    value: Quantity
    note: str
    also: tuple[Quantity, ...] = ()

    @property
    def said(self) -> str:
        """The note with its numbers inserted."""
        return self.note.format(*self.also)


def tiles(facts: Facts) -> list[Tile]:
    """The tiles for which there is data; a torn recording still has its forces."""
    result, figures = facts.window.result, facts.figures
    found = []
    if result is not None and figures is not None:
        note = f"{{}} in motion and {{}} of thinking between; the paper's one run took {PAPER_DURATION_S} s"
        also = [Quantity(figures.motion_s, "s"), Quantity(figures.thinking_s, "s")]
        if facts.calibrated_s > 0.0:
            note = "{} in motion, the sensor's calibration among it, and {} of thinking between"
        found.append(Tile("duration", Quantity(figures.duration_s, "s"), note, tuple(also)))
    found += _force_tiles(facts)
    if result is not None and figures is not None:
        on_the_way = "on the way in"
        if facts.presses:
            presses = counted(len(facts.presses), "press", "presses")
            on_the_way += f"; then {presses} against the bore's walls, once in"
        found.append(Tile("touches", Quantity(len(facts.touches), "", 0), on_the_way))
        pushes = counted(result.pushes, "push", "pushes")
        found.append(Tile("corrections", Quantity(result.corrections, "", 0), f"{pushes} in all"))
        found += _pose_tiles(facts)
    return found


def _force_tiles(facts: Facts) -> list[Tile]:
    forces = facts.forces
    peak = forces.contact
    if peak is None or forces.main is None:
        return []
    filtered = forces.contact_unfiltered is None
    how = f"every sample at {forces.main.rate_hz:.0f} Hz, unfiltered"
    how = f"filtered, at {forces.main.rate_hz:.0f} Hz" if filtered else how
    note, also = f"{how}, on the peg", []
    moment_note, moment_also = how, []
    if not filtered and forces.contact_filtered is not None:
        note += "; filtered {}"
        also.append(Quantity(forces.contact_filtered.force_n, "N"))
        moment_note += "; filtered {}"
        moment_also.append(Quantity(forces.contact_filtered.moment_nm, "Nm"))
    if forces.inertia is not None:
        note += ". Not counted: {} in free air, the tool's inertia"
        also.append(Quantity(forces.inertia.force_n, "N"))
    moment_note += "; about the sensor's origin"
    return [
        Tile("peak contact force", Quantity(peak.force_n, "N"), note, tuple(also)),
        Tile("peak contact moment", Quantity(peak.moment_nm, "Nm"), moment_note, tuple(moment_also)),
    ]


def _pose_tiles(facts: Facts) -> list[Tile]:
    figures, result = facts.figures, facts.window.result
    assert figures is not None and result is not None
    found = []
    for pose in facts.poses:
        if pose.error is None:
            continue
        vision = "(T1)" in pose.name
        name = "vision's error (T1)" if vision else "final error (T2)" if result.inserted else "last belief's error"
        note = "across the hole's axis; {} turned, {} in depth"
        turned, deep = Quantity(pose.error.rotation_deg, "°"), Quantity(pose.error.depth_mm, "mm", 3)
        found.append(Tile(name, Quantity(pose.error.lateral_mm, "mm", 3), note, (turned, deep)))
    if not figures.looked:
        pass
    elif figures.vision_refused:
        note = f"refused: {figures.vision_refused.replace('_', ' ')}" + (", then felt for" if figures.felt_for else "")
        found.append(Tile("vision", Quantity(None), note))
    if result.inserted and figures.insertion_depth_mm is not None:
        wanted = number(facts.workcell.insertion_depth_m * 1e3, 1)
        also: tuple[Quantity, ...] = ()
        whose = "by the cell's own estimate"
        if facts.truth is not None:
            whose = "by the truth; {} by the cell's own estimate"
            also = (Quantity(result.insertion_depth_m * 1e3, "mm", 1),)
        note = f"of the body past the rim, {whose}; {wanted} mm are wanted"
        found.append(Tile("insertion depth", Quantity(figures.insertion_depth_mm, "mm", 1), note, also))
    return found
