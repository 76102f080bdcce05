"""The state of the bus and of the services during the assembly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.keys import EVENTS, STATUS, topics
from crosspih_common.messages import Event, ServiceStatus, Severity
from crosspih_common.recording import Recording
from services.operator.report.model.window import AssemblyWindow


@dataclass(frozen=True, slots=True)
class KeyHealth:
    """One key over the assembly. Rates are samples a second of the cell's clock and of the recorder's; `silence_s` is
    the longest time between two consecutive samples by the cell's clock. `nominal_hz` is the rate in the key table,
    None for keys without a fixed rate. `missing` samples never came (over the whole file).
    """

    path: str
    samples: int
    kilobytes: float
    nominal_hz: float | None
    cell_hz: float | None
    wall_hz: float | None
    silence_s: float | None
    missing: int


@dataclass(frozen=True, slots=True)
class RecordingHealth:
    """All keys, the recorder's own counters (None: the file was not completed), services and their warnings."""

    keys: list[KeyHealth]
    drops: dict[str, str] | None
    services: list[ServiceStatus]
    events: list[tuple[float, Event]]

    @property
    def missing(self) -> int:
        """Samples of all keys that never came."""
        return sum(key.missing for key in self.keys)

    def dropped(self, kind: str) -> str:
        """A counter of the recorder, such as overflow, gaps, malformed or restarts; a dash where it is not known."""
        return "–" if self.drops is None else self.drops.get(f"{kind}_total", "0")


def health_of(recording: Recording, window: AssemblyWindow) -> RecordingHealth:
    """Over the assembly; missing samples are counted over the whole file."""
    nominal = {key: topic.rate_hz for topic in topics() for key in recording.keys_of(topic)}
    gaps = recording.seq_gaps()
    keys = []
    for key in sorted(recording.samples):
        within = [sample for sample in recording.samples[key] if window.holds(sample.stamp_ns)]
        stamps = np.sort([sample.stamp_ns for sample in within]) * 1e-9
        wall = np.sort([sample.wall_ns for sample in within]) * 1e-9
        keys.append(
            KeyHealth(
                "/".join(key.split("/")[2:]) or key,
                len(within),
                sum(len(sample.payload) for sample in within) / 1e3,
                nominal.get(key),
                _rate(stamps),
                _rate(wall),
                float(np.diff(stamps).max()) if len(stamps) > 2 else None,
                gaps.get(key, 0),
            )
        )
    by_service: dict[str, ServiceStatus] = {status.service: status for status in recording.messages(STATUS)}
    events = [
        (window.s(event.stamp_ns), event) for event in recording.messages(EVENTS) if event.severity is not Severity.INFO
    ]
    services = [by_service[name] for name in sorted(by_service)]
    return RecordingHealth(keys, recording.metadata.get("drops"), services, events)


def _rate(times_s: np.ndarray) -> float | None:
    """The rate between the first and the last sample; None for too few samples."""
    if len(times_s) < 3 or times_s[-1] <= times_s[0]:
        return None
    return float((len(times_s) - 1) / (times_s[-1] - times_s[0]))
