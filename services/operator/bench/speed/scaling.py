"""`crosspih bench scaling`: trials a second with one cell, with two, and so on."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Rate(BaseModel):
    """The speed of this many cells, once all are up. `linear` is the rate divided by this many times
    that of one cell.
    """

    model_config = ConfigDict(frozen=True)

    cells: int
    trials: int
    elapsed_s: float
    trials_s: float
    linear: float
    slowest_start_s: float


class ScalingResult(BaseModel):
    """What `crosspih bench scaling --json` prints."""

    model_config = ConfigDict(frozen=True)

    executor: str
    cores: int
    each_on_one_core: bool
    rates: list[Rate]
