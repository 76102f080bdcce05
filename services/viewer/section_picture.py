"""The peg's section as a picture: which arms of the cross touch, and in which direction the measured force pushes."""

from __future__ import annotations

from html import escape

import numpy as np

from crosspih_common.contacts.arm_edges import ARM_DIRECTIONS
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import ContactState
from crosspih_common.shapes import CrossPeg, Peg

SIZE = 120.0  # half the picture's width, in its own units
FILLED = 62.0  # the outline's extent in these units
MIN_ARROW_N, ARROW_FULL_N = 0.5, 15.0
LIT, WALL, QUIET = "#f59f00", "#e8590c", "var(--mantine-color-default-border)"


def arms_of(state: ContactState | None) -> tuple[int, ...]:
    """The touching arms, 1 to 4 along +x, +y, -x, -y of the peg frame, for a contact state of the paper's tables."""
    if state is None or state.case is None:
        return ()
    count, _, case = (int(part) for part in state.case.split("-"))
    if count == 4:
        return (1, 2, 3, 4)
    if count == 3:
        return tuple(arm for arm in (1, 2, 3, 4) if arm != case)
    return (case,) if count == 1 else tuple(sorted((case, case % 4 + 1)))


def section_svg(peg: Peg, state: ContactState | None, wrench: Array | None) -> str:
    """The section as seen from the arm, along the peg's axis towards the hole: x to the right, y down.

    The arms of `state` are highlighted, with the side that the wall presses on; an arrow shows the lateral force of
    `wrench`.
    """
    scale = FILLED / peg.outline.reach_m
    points = " ".join(f"{x * scale:.1f},{y * scale:.1f}" for x, y in peg.outline.corners_m)
    parts = [
        f'<svg viewBox="{-SIZE:g} {-SIZE:g} {2 * SIZE:g} {2 * SIZE:g}" role="img" '
        f'aria-label="{escape(words_of(state))}" style="width:100%;max-width:190px;display:block;margin:auto">',
        f'<rect x="-100" y="-100" width="200" height="200" rx="10" fill="{QUIET}" fill-opacity="0.35"/>',
        f'<polygon points="{points}" fill="var(--mantine-color-body)" stroke="var(--mantine-color-dimmed)" '
        f'stroke-width="2" stroke-linejoin="round"/>',
    ]
    if isinstance(peg, CrossPeg):
        parts += _arms(peg, scale, state)
    parts += _axes()
    if wrench is not None:
        parts += _arrow(wrench)
    parts.append("</svg>")
    return "".join(parts)


def words_of(state: ContactState | None) -> str:
    """The state in words."""
    if state is None:
        return "nothing is told yet"
    if state.case is None:
        return state.reason or "none of the 26 states"
    arms = arms_of(state)
    named = ", ".join(f"{'+-'[arm > 2]}{'xy'[(arm - 1) % 2]}" for arm in arms)
    turned = "alpha < 0" if state.sense == 1 else "alpha > 0"
    return f"state {state.case}: the arm{'s' * (len(arms) > 1)} {named}; {turned}; confidence {state.confidence:.2f}"


def _arms(peg: CrossPeg, scale: float, state: ContactState | None) -> list[str]:
    parts = []
    half, reach = peg.half_width_m * scale, peg.half_length_m * scale
    for arm in arms_of(state):
        along = ARM_DIRECTIONS[arm - 1, :2]
        across = np.array([-along[1], along[0]])
        # a push along sense x (z x u) comes from the wall on the other side of the arm
        wall = across * (1.0 if state is not None and state.sense == 1 else -1.0)
        corners = [along * half - across * half, along * reach - across * half]
        corners += [along * reach + across * half, along * half + across * half]
        inside = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        parts.append(f'<polygon points="{inside}" fill="{LIT}" fill-opacity="0.8"/>')
        (x1, y1), (x2, y2) = along * half * 1.25 + wall * half, along * reach + wall * half
        parts.append(
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{WALL}" stroke-width="6" '
            f'stroke-linecap="round"/>'
        )
    return parts


def _axes() -> list[str]:
    style = 'fill="var(--mantine-color-dimmed)" font-size="15" text-anchor="middle" dominant-baseline="central"'
    where = (("+x", 87, 0), ("+y", 0, 87), ("-x", -87, 0), ("-y", 0, -87))
    return [f'<text x="{x}" y="{y}" {style}>{name}</text>' for name, x, y in where]


def _arrow(wrench: Array) -> list[str]:
    force = np.asarray(wrench, float)[:2]
    size = float(np.hypot(*force))
    if size < MIN_ARROW_N:
        return []
    length = 12.0 + (FILLED - 8.0) * min(size / ARROW_FULL_N, 1.0)
    unit = force / size
    tip, side = unit * length, np.array([-unit[1], unit[0]]) * 6.0
    back = unit * (length - 13.0)
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (tip, back + side, back - side))
    return [
        f'<line x1="0" y1="0" x2="{back[0]:.1f}" y2="{back[1]:.1f}" stroke="#228be6" stroke-width="5"/>',
        f'<polygon points="{head}" fill="#228be6"/>',
    ]
