"""A network that is worth nothing says so."""

from __future__ import annotations

import pytest

from services.inference.network.paper.evaluation import doubts_of


@pytest.mark.parametrize(
    ("best", "trained", "rms", "said"),
    [
        (9, True, [1.0, 1.0, 1.0], []),
        (0, True, [1.0, 1.0, 1.0], ["epoch 0"]),
        (0, False, [1.0, 1.0, 1.0], []),  # without a validation error the last epoch is kept
        (9, True, [1.0, 3.0, 2.0], ["beta (3.00° against 2.00°), gamma (2.00° against 2.00°)"]),
        (0, True, [3.0, 3.0, 3.0], ["epoch 0", "alpha (3.00° against 2.00°), beta"]),
    ],
)
def test_what_speaks_against_a_network_is_said(best: int, trained: bool, rms: list[float], said: list[str]) -> None:
    doubts = doubts_of(best, trained, {"rms_deg": rms}, {"rms_deg": [2.0, 2.0, 2.0]})
    assert len(doubts) == len(said) and all(part in doubt for part, doubt in zip(said, doubts, strict=True))
