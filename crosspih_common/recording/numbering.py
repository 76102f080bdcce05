"""Finds missing samples by a publisher's sequence numbers, although some samples come late and some may be forged.

A gap of more than `JUMP`, or a restart of the count, is accepted only when the next number continues from there; a
number that fits nowhere is a stray and no gap. So a forged number cannot claim more losses than samples were possible.
"""

from __future__ import annotations

from dataclasses import dataclass, field

# a jump of at most this many numbers is accepted at once: the publisher's cache holds as many
JUMP = 64
# how much more often than its usual rate a publisher may send
RATE_MARGIN = 4.0
HOLES = 256  # gaps kept for each key, which late samples may fill


@dataclass(slots=True)
class Line:
    """The numbers of one publisher on one key, as far as they are known.

    `expected` is the next one. `holes` are the ranges [begin, end) that did not come yet. `stray` is the number after
    one that fitted nowhere: if it comes next, the publisher's numbers continue from there.
    """

    expected: int
    heard_s: float
    holes: list[tuple[int, int]] = field(default_factory=list)
    given_up: int = 0  # in holes that are no longer kept
    stray: int | None = None
    strays: int = 0
    restarts: int = 0

    def missing(self) -> int:
        """Samples that never came."""
        return self.given_up + sum(end - begin for begin, end in self.holes)

    def begin(self) -> None:
        """Count from zero; the numbers go on."""
        self.holes.clear()
        self.given_up = self.strays = self.restarts = 0

    def count_sample(self, seq: int, now_s: float, rate_hz: float) -> None:
        """Count a received sample by its number, with the time, s, of any monotonic clock."""
        if seq == self.expected:
            self.expected = seq + 1
        elif self.expected < seq <= self.expected + JUMP:
            self._skip_to(seq)
        elif self.stray == seq:
            self._go_on_at(seq, JUMP + RATE_MARGIN * rate_hz * max(now_s - self.heard_s, 0.0))
        else:
            if not self._fill(seq):
                self.strays += 1
                self.stray = seq + 1
            return
        self.heard_s = now_s

    def _go_on_at(self, seq: int, plausible: float) -> None:
        """Accept two consecutive unexpected numbers as the publisher's new count, after a restart or a gap."""
        # the one before belongs to it, unless it was counted for the recording before
        self.strays = max(self.strays - 1, 0)
        self.stray = None
        if self.expected < seq <= self.expected + plausible:
            self._skip_to(seq - 1)
        else:
            self.given_up = self.missing()
            self.holes.clear()
            self.restarts += 1
        self.expected = seq + 1

    def _skip_to(self, seq: int) -> None:
        if seq > self.expected:
            self.holes.append((self.expected, seq))
            if len(self.holes) > HOLES:
                begin, end = self.holes.pop(0)
                self.given_up += end - begin
        self.expected = seq + 1

    def _fill(self, seq: int) -> bool:
        for index, (begin, end) in enumerate(self.holes):
            if begin <= seq < end:
                parts = ((begin, seq), (seq + 1, end))
                self.holes[index : index + 1] = [part for part in parts if part[0] < part[1]]
                return True
        return False
