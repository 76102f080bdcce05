"""SVG's lengths, transforms and viewports (SVG 2, chapters 7 and 8), each understood or refused."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.drawn.curves import DrawingRefused
from crosspih_common.shapes.drawn.svg_paths import numbers

PX_MM = 25.4 / 96.0
_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72.0, "pc": 25.4 / 6.0, "q": 0.25}
_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-z]*|%)\s*")
_CALL = re.compile(r"\s*,?\s*([A-Za-z0-9]+)\s*\(([^()]*)\)\s*")
_ALIGN = re.compile(r"x(Min|Mid|Max)Y(Min|Mid|Max)")
_SHARE = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}


@dataclass(frozen=True, slots=True)
class Viewport:
    """The reference lengths of percentages, user units."""

    width: float
    height: float

    def of(self, axis: str) -> float:
        """The reference of a percentage along x, y, or of a radius."""
        both = float(np.hypot(self.width, self.height) / np.sqrt(2.0))
        return self.width if axis == "x" else self.height if axis == "y" else both


def physical_mm(name: str, said: str | None) -> float:
    """The page's width or height, mm. DrawingRefused where it has no unit of length."""
    found = _LENGTH.fullmatch(said or "")
    if found is None or found[2].lower() not in _MM:
        raise DrawingRefused(
            f'svg: {name} has no unit of length (got {said!r}); write it as {name}="60mm" with a viewBox'
        )
    value = float(found[1]) * _MM[found[2].lower()]
    if not 0.0 < value < 1e6:
        raise DrawingRefused(f"svg: {name} is {said!r}; a page has a size")
    return value


def user_units(entity: str, name: str, said: str | None, default: float, viewport: Viewport, axis: str) -> float:
    """A length of an element, user units. DrawingRefused for a unit that is not known here."""
    if said is None or said.strip() in ("", "auto"):
        return default
    found = _LENGTH.fullmatch(said)
    unit = "" if found is None else found[2].lower()
    if found is None or unit not in ("", "px", "%", *_MM):
        raise DrawingRefused(f"{entity}: {name} is {said!r}; write a number without a unit, or one in mm")
    value = float(found[1])
    if unit == "%":
        return value / 100.0 * viewport.of(axis)
    return value if unit in ("", "px") else value * _MM[unit] / PX_MM


def matrix_of(entity: str, said: str | None) -> Array:
    """(3, 3): of the attribute `transform`."""
    result = np.eye(3)
    rest = (said or "").strip()
    if rest in ("", "none"):
        return result
    while rest:
        call = _CALL.match(rest)
        values = None if call is None else numbers(call[2])
        one = None if call is None or values is None else _one(call[1], values)
        if call is None or one is None or not np.all(np.isfinite(one)):
            raise DrawingRefused(
                f"{entity}: transform {rest[:40]!r} is not understood; apply it in the drawing program"
            )
        result, rest = result @ one, rest[call.end() :].lstrip(", \t\r\n")
    if abs(np.linalg.det(result)) < 1e-12:
        raise DrawingRefused(f"{entity}: transform {said!r} leaves nothing of it; remove it or mend the transform")
    return result


def _one(name: str, values: list[float]) -> Array | None:
    count = len(values)
    if name == "matrix" and count == 6:
        a, b, c, d, e, f = values
        return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])
    if name == "translate" and count in (1, 2):
        return shifted(values[0], values[1] if count == 2 else 0.0)
    if name == "scale" and count in (1, 2):
        return np.diag([values[0], values[-1], 1.0])
    if name == "rotate" and count in (1, 3):
        angle = np.deg2rad(values[0])
        turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        return turn if count == 1 else shifted(values[1], values[2]) @ turn @ shifted(-values[1], -values[2])
    if name in ("skewX", "skewY") and count == 1:
        skewed = np.eye(3)
        skewed[(0, 1) if name == "skewX" else (1, 0)] = np.tan(np.deg2rad(values[0]))
        return skewed
    return None


def shifted(x: float, y: float) -> Array:
    """(3, 3): a translation."""
    result = np.eye(3)
    result[:2, 2] = x, y
    return result


def view_box(entity: str, said: str | None) -> tuple[float, float, float, float] | None:
    """min-x, min-y, width and height; None where there is none."""
    if said is None or not said.strip():
        return None
    values = numbers(said)
    if values is None or len(values) != 4 or not values[2] > 0.0 or not values[3] > 0.0:
        raise DrawingRefused(f'{entity}: viewBox is {said!r}; it wants four numbers, as in viewBox="0 0 60 60"')
    return values[0], values[1], values[2], values[3]


def fitted(
    entity: str, box: tuple[float, float, float, float], width: float, height: float, ratio: str | None
) -> Array:
    """(3, 3): a viewBox into a viewport of a width and a height, as preserveAspectRatio says."""
    words = (ratio or "xMidYMid meet").split()
    align = words[0] if words else ""
    found = _ALIGN.fullmatch(align)
    slicing = words[1:] == ["slice"]
    if (align != "none" and found is None) or words[1:] not in ([], ["meet"], ["slice"]):
        raise DrawingRefused(f"{entity}: preserveAspectRatio {ratio!r} is not understood; write xMidYMid meet, or none")
    scale_x, scale_y = width / box[2], height / box[3]
    shift_x = shift_y = 0.0
    if found is not None:
        scale_x = scale_y = max(scale_x, scale_y) if slicing else min(scale_x, scale_y)
        shift_x = _SHARE[found[1]] * (width - box[2] * scale_x)
        shift_y = _SHARE[found[2]] * (height - box[3] * scale_y)
    return shifted(shift_x, shift_y) @ np.diag([scale_x, scale_y, 1.0]) @ shifted(-box[0], -box[1])
