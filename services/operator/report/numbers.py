"""Numbers formatted for people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


def number(value: float | None, digits: int = 2) -> str:
    """With a true minus sign, a dash where there is no value, and no minus zero."""
    if value is None or not np.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with its unit and number of digits; the same object wherever the number is shown."""

    value: float | None
    unit: str = ""
    digits: int = 2

    @property
    def text(self) -> str:
        """The number alone."""
        return number(self.value, self.digits)

    def __str__(self) -> str:
        if self.value is None or not self.unit:
            return self.text
        return f"{self.text}{'' if self.unit == '°' else ' '}{self.unit}"
