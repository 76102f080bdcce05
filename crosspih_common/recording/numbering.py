"""What a publisher's numbers say of samples that never came, when some come late and some may be forged.

One number says little. A gap of more than `JUMP` and a new beginning are believed when the next number goes on from
there; a number that fits nowhere is a stray, and no gap. So no number can claim a loss beyond what can have been sent.
"""

from __future__ import annotations

from dataclasses import dataclass, field

# a jump of so few numbers is believed at once: the publisher's cache holds as many
JUMP = 64
# how often a publisher may speak beyond its usual rate
RATE_MARGIN = 4.0
HOLES = 256  # that are kept, a key, to be filled by samples that come late


@dataclass(slots=True)
class Line:
    """The numbers of one publisher on one key, as far as they are known.

    `expected` is the next one. `holes` are the ranges [begin, end) that did not come yet. `stray` is the number after
    one that fitted nowhere: if it comes next, that is where the publisher's numbers go on.
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
        """A sample with this number came, at a time of any clock that only goes forward."""
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
        """Two in a row where none was expected: that is where the publisher is now, started again or after a gap."""
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
