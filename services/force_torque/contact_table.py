"""The 26 contact states of a cross peg and the signs of their wrenches (Tables 2-5).

A state is named count-sense-case. `count` (w1) is how many arms touch; `sense` (w2) is 1 for alpha < 0 and 2 for
alpha > 0, so that the wrench turns the peg the other way: Mz < 0 and Mz > 0. `case` says which arms: one arm k; arms
k and k + 1; all arms but k; all four. Arms 1 to 4 lie along +x, +y, -x, -y of the peg frame.

The tables follow from one rule, and are checked against it: an arm at azimuth u is pushed sideways along -(z x u)
for sense 1 and +(z x u) for sense 2, and a little along -z; the moments are those of the forces at some height z > 0
ahead of the origin. (The text copy of the paper lost its minus signs; the remaining signs leave open which of arms 1
and 3 lies along +x.)
"""

from __future__ import annotations

from dataclasses import dataclass

Signs = tuple[int, int, int, int, int, int]

_SIGN = {"+": 1, "-": -1, "0": 0}

# Fx Fy Fz Mx My Mz
_ROWS = """
1-1-1 0--+0-   1-2-1 0+--0+   3-1-1 0+--0-   3-2-1 0--+0+
1-1-2 +0-0+-   1-2-2 -0-0-+   3-1-2 -0-0--   3-2-2 +0-0++
1-1-3 0+--0-   1-2-3 0--+0+   3-1-3 0--+0-   3-2-3 0+--0+
1-1-4 -0-0--   1-2-4 +0-0++   3-1-4 +0-0+-   3-2-4 -0-0-+
2-1-1 +--++-   2-2-1 -+---+   4-1-1 00-00-   4-2-1 00-00+
2-1-2 ++--+-   2-2-2 ---+-+
2-1-3 -+----   2-2-3 +--+++
2-1-4 ---+--   2-2-4 ++--++
"""


@dataclass(frozen=True, slots=True)
class StateRow:
    """One of the 26 states: its numbers, and the signs of Fx Fy Fz Mx My Mz."""

    count: int
    sense: int
    case: int
    signs: Signs

    @property
    def name(self) -> str:
        """As the paper writes it, for example "1-2-2"."""
        return f"{self.count}-{self.sense}-{self.case}"

    @property
    def arms(self) -> tuple[int, ...]:
        """The touching arms, ascending."""
        return touching_arms(self.count, self.case)


def touching_arms(count: int, case: int) -> tuple[int, ...]:
    """The arms of a case: (k), (k, k + 1), all but k, or all. Raises ValueError for a case that is not in the
    tables."""
    if case not in ((1, 2, 3, 4) if count in (1, 2, 3) else (1,)) or count not in (1, 2, 3, 4):
        raise ValueError(f"no case {case} of {count} contacts in Tables 2-5")
    if count == 1:
        return (case,)
    if count == 2:
        return tuple(sorted((case, case % 4 + 1)))
    return tuple(arm for arm in (1, 2, 3, 4) if count == 4 or arm != case)


def _parse(text: str) -> tuple[StateRow, ...]:
    tokens = text.split()
    rows = []
    for name, signs in zip(tokens[::2], tokens[1::2], strict=True):
        count, sense, case = (int(part) for part in name.split("-"))
        fx, fy, fz, mx, my, mz = (_SIGN[sign] for sign in signs)
        rows.append(StateRow(count, sense, case, (fx, fy, fz, mx, my, mz)))
    return tuple(sorted(rows, key=lambda row: (row.count, row.sense, row.case)))


STATES: tuple[StateRow, ...] = _parse(_ROWS)
"""All 26 states, by count, sense and case."""


def signs_text(signs: Signs) -> str:
    """For example "- 0 - 0 - +", in the order Fx Fy Fz Mx My Mz."""
    return " ".join("-0+"[sign + 1] for sign in signs)
