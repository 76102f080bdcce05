"""SVG's path data (SVG 2, chapter 9) as points, read strictly: what is no path data is refused, not skipped."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.drawn.curves import DrawingRefused

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_COMMAND = re.compile(r"([MmZzLlHhVvCcSsQqTtAa])")
_ARC = re.compile(
    r"\s*,?\s*".join([r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"] * 3 + [r"([01])"] * 2)
    + r"\s*,?\s*"
    + r"\s*,?\s*".join([r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"] * 2)
)
_COUNT = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_MAX_CHORDS = 4096


def numbers(text: str) -> list[float] | None:
    """The numbers in a list with blanks or commas; None where something else is in it."""
    if _NUMBER.sub("", text).strip(" \t\r\n\f,"):
        return None
    return [float(found) for found in _NUMBER.findall(text)]


def subpaths(data: str, tolerance: float) -> list[Array]:
    """The points (n, 2) of each subpath, user units, no farther off its curves than a tolerance.

    Raises DrawingRefused with the command that is not understood.
    """
    found: list[list[Array]] = []
    here, start, handle, last = np.zeros(2), np.zeros(2), None, ""
    for name, rows in _commands(data):
        kind, relative = name.upper(), name.islower()
        if kind == "Z":
            found[-1].append(start[None])
            here, last = start, "Z"
            continue
        if kind == "M":
            here = rows[0] + here if relative else rows[0]
            start, handle, last = here, None, "M"
            found.append([here[None]])
            rows = rows[1:]
            if not len(rows):
                continue
            kind = "L"
        if last == "Z":
            found.append([here[None]])
        last = kind
        if kind == "L":
            points = here + np.cumsum(rows, axis=0) if relative else rows
            found[-1].append(points)
            here, handle = points[-1], None
            continue
        for row in rows:
            points, here, handle = _segment(kind, row, here, handle, relative, tolerance)
            found[-1].append(points)
    return [np.vstack(parts) for parts in found]


def _commands(data: str) -> Iterator[tuple[str, Array]]:
    pieces = _COMMAND.split(data)
    if pieces[0].strip():
        raise DrawingRefused(f"path data begins with {pieces[0].strip()[:20]!r}; it wants M first")
    for place, (name, text) in enumerate(zip(pieces[1::2], pieces[2::2], strict=True)):
        kind = name.upper()
        if place == 0 and kind != "M":
            raise DrawingRefused(f"path data begins with {name}; it wants M first")
        values = _arc_numbers(text) if kind == "A" else numbers(text)
        wanted = _COUNT[kind]
        if values is None or (len(values) % wanted if wanted else values) or (wanted and not values):
            raise DrawingRefused(
                f"path data {name}{text.rstrip()[:30]} is not understood; {name} wants {wanted} numbers"
            )
        rows = np.array(values, dtype=float).reshape(-1, max(wanted, 1))
        if not np.all(np.isfinite(rows)):
            raise DrawingRefused(f"path data {name}{text.rstrip()[:30]} has a number beyond all measure")
        yield name, rows


def _arc_numbers(text: str) -> list[float] | None:
    if _ARC.sub("", text).strip(" \t\r\n\f,"):
        return None
    return [float(value) for row in _ARC.findall(text) for value in row]


def _segment(
    kind: str, row: Array, here: Array, handle: tuple[str, Array] | None, relative: bool, tolerance: float
) -> tuple[Array, Array, tuple[str, Array] | None]:
    """Points (n, 2) after `here`, the last of them, and the handle that S and T reflect."""
    if kind in "HV":
        axis = "HV".index(kind)
        end = here.copy()
        end[axis] = row[0] + (here[axis] if relative else 0.0)
        return end[None], end, None
    if kind == "A":
        end = row[5:] + (here if relative else 0.0)
        return _arc(here, row[0], row[1], row[2], row[3] > 0.5, row[4] > 0.5, end, tolerance), end, None
    given = row.reshape(-1, 2) + (here if relative else 0.0)
    if kind in "ST":
        family = "C" if kind == "S" else "Q"
        mirrored = 2.0 * here - handle[1] if handle is not None and handle[0] == family else here
        given = np.vstack([mirrored[None], given])
    family = "C" if kind in "CS" else "Q"
    control = np.vstack([here[None], given])
    return _bezier(control, tolerance), control[-1], (family, control[-2])


def _bezier(control: Array, tolerance: float) -> Array:
    degree = len(control) - 1
    bend = float(np.max(np.hypot(*np.diff(control, 2, axis=0).T)))
    count = _chords(np.sqrt(degree * (degree - 1) / 8.0 * bend / tolerance))
    t = np.linspace(0.0, 1.0, count + 1)[1:, None]
    points = np.broadcast_to(control, (len(t), *control.shape))
    for _ in range(degree):  # de Casteljau
        points = points[:, :-1] * (1.0 - t[:, None]) + points[:, 1:] * t[:, None]
    return np.vstack([points[:-1, 0], control[-1:]])


def _arc(
    start: Array, rx: float, ry: float, turn_deg: float, large: bool, sweep: bool, end: Array, tolerance: float
) -> Array:
    """SVG 2, implementation notes B.2: from ends and radii to the centre and angles."""
    rx, ry = abs(rx), abs(ry)
    if rx == 0.0 or ry == 0.0 or np.array_equal(start, end):
        return end[None]
    cos, sin = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    turn = np.array([[cos, -sin], [sin, cos]])
    half = turn.T @ (start - end) / 2.0
    ratio = (half[0] / rx) ** 2 + (half[1] / ry) ** 2
    grown = np.sqrt(max(ratio, 1.0))
    rx, ry = rx * grown, ry * grown
    u = half / [rx, ry]
    square = float(u @ u)
    factor = np.sqrt(max(0.0, 1.0 / square - 1.0)) * (-1.0 if large == sweep else 1.0)
    centre_u = factor * np.array([u[1], -u[0]])
    first, last = u - centre_u, -u - centre_u
    angle = float(np.arctan2(first[1], first[0]))
    swept = float(np.arctan2(last[1], last[0])) - angle
    swept = swept % (2.0 * np.pi) if sweep else -((-swept) % (2.0 * np.pi))
    step = 2.0 * np.arccos(max(-1.0, 1.0 - min(1.0, tolerance / max(rx, ry))))
    angles = angle + swept * np.linspace(0.0, 1.0, _chords(abs(swept) / max(step, 1e-4)) + 1)[1:]
    on_circle = np.column_stack([np.cos(angles), np.sin(angles)]) + centre_u
    points = on_circle * [rx, ry] @ turn.T + (start + end) / 2.0
    return np.vstack([points[:-1], end[None]])


def _chords(wanted: float) -> int:
    return int(min(max(np.ceil(wanted), 1.0), _MAX_CHORDS))
