"""`crosspih bench inference`: the cost of each answer of the inference service compared with its bare computation."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field
from rich.table import Table

PROGRAM = "services.inference.rate"


class Cost(BaseModel):
    """CPU time of one answer and of its reference."""

    model_config = ConfigDict(frozen=True)

    ours_s: float = Field(gt=0.0)
    bare_s: float = Field(gt=0.0)
    beside: str

    @property
    def ratio(self) -> float:
        """The answer's time as a multiple of the bare computation's."""
        return self.ours_s / self.bare_s


class InferenceResult(BaseModel):
    """What `crosspih bench inference --json` prints: a cost a question."""

    model_config = ConfigDict(frozen=True)

    costs: dict[str, Cost]


def table_of(result: InferenceResult) -> Table:
    """A row a question."""
    table = Table(title="CPU time of an answer, and of the bare thing in the same run")
    for column in ("asked", "ours ms", "bare ms", "ratio", "the bare thing"):
        table.add_column(column, justify="left" if column in ("asked", "the bare thing") else "right")
    for asked, cost in result.costs.items():
        table.add_row(asked, f"{cost.ours_s * 1e3:.2f}", f"{cost.bare_s * 1e3:.3f}", f"{cost.ratio:.2f}", cost.beside)
    return table
