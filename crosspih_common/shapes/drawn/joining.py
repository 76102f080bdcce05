"""One closed curve out of all that a file draws: lines and arcs that follow each other end to end are joined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from shapely import LineString

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes.drawn.curves import JOINED_M, Curve, DrawingRefused, Sheet

_NAMED = 4


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    curves: tuple[Curve, ...]
    points_m: Array

    @property
    def name(self) -> str:
        first, rest = self.curves[0].entity, len(self.curves) - 1
        return first if not rest else f"{first} with {rest} more joined to it"


def only_closed_curve(sheet: Sheet) -> Curve:
    """The outline, its last point its first. DrawingRefused names what is open, where, and by how much."""
    curves = [curve for curve in sheet.curves if not _is_a_speck(curve)]
    if not curves:
        left = f" that is drawn (left out: {_listed(sheet.left_out)})" if sheet.left_out else ""
        raise DrawingRefused(f"holds no curve{left}; draw the peg's outline as one closed curve")
    closed = [_Chain((curve,), curve.points_m) for curve in curves if curve.closed]
    open_ones = [curve for curve in curves if not curve.closed]
    ends = np.array([curve.points_m[[0, -1]] for curve in open_ones]).reshape(-1, 2)
    chains = _chains(sheet, open_ones, ends) if len(open_ones) else []
    still_open = [chain for chain in chains if np.hypot(*(chain.points_m[-1] - chain.points_m[0])) > JOINED_M]
    if still_open:
        raise DrawingRefused(_gap(sheet, still_open))
    closed += chains
    if len(closed) > 1:
        names = _listed([chain.name for chain in closed])
        raise DrawingRefused(f"holds {len(closed)} outlines ({names}); leave the peg's own, without holes")
    points = closed[0].points_m
    return Curve(closed[0].curves[0].entity, np.vstack([points[:-1], points[:1]]))


def _is_a_speck(curve: Curve) -> bool:
    return float(np.max(np.ptp(curve.points_m, axis=0))) <= JOINED_M


def _chains(sheet: Sheet, curves: list[Curve], ends: Array) -> list[_Chain]:
    """End 2 i is the start of curve i, end 2 i + 1 its end."""
    partner: dict[int, int] = {}
    for one, other in sorted(cKDTree(ends).query_pairs(JOINED_M)):
        if one // 2 == other // 2:
            continue
        for end in (one, other):
            if end in partner:
                three = [curves[index // 2] for index in (end, partner[end], one if end == other else other)]
                raise DrawingRefused(_fork(sheet, three, ends[end]))
        partner[one], partner[other] = other, one
    used: set[int] = set()
    chains = []
    # open chains are walked from a free end, so that each is found whole
    free = [end for end in range(len(ends)) if end not in partner]
    for start in (*free, *range(0, len(ends), 2)):
        if start // 2 in used:
            continue
        members, points, end = [], [], start
        while end // 2 not in used:
            used.add(end // 2)
            curve = curves[end // 2]
            members.append(curve)
            points.append(curve.points_m if end % 2 == 0 else curve.points_m[::-1])
            following = partner.get(end ^ 1)
            if following is None:
                break
            end = following
        joined = [points[0], *(part[1:] for part in points[1:])]
        chains.append(_Chain(tuple(members), np.vstack(joined)))
    return chains


def _fork(sheet: Sheet, three: list[Curve], place_m: Array) -> str:
    for index, one in enumerate(three):
        for other in three[index + 1 :]:
            if one is not other and LineString(one.points_m).hausdorff_distance(LineString(other.points_m)) < JOINED_M:
                return f"{one.entity} is drawn twice, {other.entity} lies on it; delete one of them"
    names = ", ".join(dict.fromkeys(curve.entity for curve in three))
    return f"three ends meet at {sheet.place(place_m)} mm ({names}); leave the one closed curve of the peg's outline"


def _gap(sheet: Sheet, chains: list[_Chain]) -> str:
    """The gap that is the likeliest to be meant closed: the narrowest."""
    ends = np.array([chain.points_m[[0, -1]] for chain in chains]).reshape(-1, 2)
    found = cKDTree(ends).query(ends, k=2)
    distances, nearest = np.asarray(found[0]), np.asarray(found[1])
    # where two ends coincide, the nearest of one may be itself or the other
    other_of = np.where(nearest[:, 0] == np.arange(len(ends)), nearest[:, 1], nearest[:, 0])
    one = int(np.argmin(distances[:, 1]))
    other, width_mm = int(other_of[one]), float(distances[one, 1]) * 1e3
    first, second = chains[one // 2], chains[other // 2]
    places = f"at {sheet.place(ends[one])} and {sheet.place(ends[other])} mm"
    more = f" ({len(chains)} curves are open)" if len(chains) > 1 else ""
    if first is second:
        return f"{first.name} is open: its ends are {width_mm:.3f} mm apart, {places}; close it{more}"
    return (
        f"{first.name} is open: from its end to that of {second.name} there is a gap of {width_mm:.3f} mm, {places}; "
        f"close it{more}"
    )


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
