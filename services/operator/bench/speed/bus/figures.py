"""Figures from the samples sent and received. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict


class BusRound(BaseModel):
    """One way's turn of one round: delays at a steady rate, and a burst at full speed."""

    model_config = ConfigDict(frozen=True)

    delays_us: tuple[float, ...]
    burst_sent: int
    burst_heard: int
    burst_s: float
    send_cpu_s: float
    hear_cpu_s: float


class WayFigures(BaseModel):
    """A way's figures over all rounds; ratios are medians over the rounds, each against the other of the same round."""

    model_config = ConfigDict(frozen=True)

    way: str
    p50_us: float
    p95_us: float
    p50_ratio: float
    messages_s: float
    throughput_ratio: float
    throughput_of_pydantic: float
    send_cpu_us: float
    hear_cpu_us: float
    lost: float


def delays_us(sent_ns: Mapping[int, int], heard_ns: Mapping[int, int]) -> tuple[float, ...]:
    """From publish to callback, for the samples received, in the order of their numbers."""
    return tuple((heard_ns[number] - sent_ns[number]) * 1e-3 for number in sent_ns if number in heard_ns)


def turn_of(
    steady_sent_ns: Mapping[int, int], burst_sent_ns: Mapping[int, int], heard_ns: Mapping[int, int],
    cpu_s: tuple[float, float],
) -> BusRound:  # fmt: skip
    """A turn from the times of all its samples, by number; the burst lasts from its first send to its last receipt.

    `cpu_s`: of the sending and of the listening process, in the burst.
    """
    burst = [heard_ns[number] for number in burst_sent_ns if number in heard_ns]
    began_ns = min(burst_sent_ns.values())
    return BusRound(
        delays_us=delays_us(steady_sent_ns, heard_ns), burst_sent=len(burst_sent_ns), burst_heard=len(burst),
        send_cpu_s=cpu_s[0], hear_cpu_s=cpu_s[1], burst_s=(max(burst) - began_ns) * 1e-9 if burst else float("inf"),
    )  # fmt: skip


def _rate(turn: BusRound) -> float:
    return turn.burst_heard / turn.burst_s


def _p50(turn: BusRound) -> float:
    return float(np.median(turn.delays_us)) if turn.delays_us else float("nan")


def figures_of(rounds: Sequence[Mapping[str, BusRound]], bare: str, dumped: str) -> list[WayFigures]:
    """One row per way; `bare` is the way to which ratios refer, `dumped` is the bare one plus
    pydantic-core's own work.
    """
    rows = []
    for way in rounds[0]:
        turns = [one[way] for one in rounds]
        delays = np.concatenate([turn.delays_us for turn in turns])
        rows.append(
            WayFigures(
                way=way, p50_us=float(np.percentile(delays, 50)), p95_us=float(np.percentile(delays, 95)),
                p50_ratio=float(np.median([_p50(one[way]) / _p50(one[bare]) for one in rounds])),
                messages_s=float(np.median([_rate(turn) for turn in turns])),
                throughput_ratio=float(np.median([_rate(one[way]) / _rate(one[bare]) for one in rounds])),
                throughput_of_pydantic=float(np.median([_rate(one[way]) / _rate(one[dumped]) for one in rounds])),
                send_cpu_us=float(np.median([turn.send_cpu_s / turn.burst_sent for turn in turns])) * 1e6,
                hear_cpu_us=float(np.median([turn.hear_cpu_s / max(turn.burst_heard, 1) for turn in turns])) * 1e6,
                lost=1.0 - sum(turn.burst_heard for turn in turns) / sum(turn.burst_sent for turn in turns),
            )
        )  # fmt: skip
    return rows
