"""The assembly of a recording that a report is about, and the cell in which it was made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import yaml
from pydantic import ValidationError

from crosspih_common.config import Workcell
from crosspih_common.keys import ASSEMBLE, PHASE
from crosspih_common.messages import Assemble, AssemblyPhase, AssemblyResult, Phase
from crosspih_common.plain_yaml import yaml_of
from crosspih_common.recording import Recording


@dataclass(frozen=True, slots=True)
class AssemblyWindow:
    """The last assembly of a recording, from its command to its answer, or the nearest recorded times to these.

    Stamps are of the cell's clock; `wall_s` is by the recorder's clock, None where it is not known.
    """

    start_ns: int
    end_ns: int
    request: Assemble | None
    result: AssemblyResult | None
    phases: tuple[tuple[AssemblyPhase, int], ...]  # each with the recorder's clock, ns
    wall_s: float | None

    def s(self, stamp_ns: int) -> float:
        """Seconds since the command."""
        return (stamp_ns - self.start_ns) * 1e-9

    def holds(self, stamp_ns: int) -> bool:
        """Whether a stamp lies within the window."""
        return self.start_ns <= stamp_ns <= self.end_ns


def window_of(recording: Recording) -> AssemblyWindow:
    """The last one of several assemblies in a recording."""
    requests, replies = recording.sent(ASSEMBLE.request_echo), recording.sent(ASSEMBLE.reply_echo)
    told = [(sent.value, sent.wall_ns) for sent in recording.sent(PHASE)]
    first, last = recording.span_ns()
    result = replies[-1].value if replies else None
    if requests and result is not None and requests[-1].value.stamp_ns > result.stamp_ns:
        result = None  # a later one was requested and did not end
    end_ns = result.stamp_ns if result is not None else last
    begun = [request for request in requests if request.value.stamp_ns <= end_ns]
    start_ns = begun[-1].value.stamp_ns if begun else (told[0][0].stamp_ns if told else first)
    phases = tuple(
        (phase, wall_ns)
        for phase, wall_ns in told
        if start_ns <= phase.stamp_ns <= end_ns and phase.phase is not Phase.IDLE
    )
    wall_s = None
    if begun and result is not None:
        wall_s = (replies[-1].wall_ns - begun[-1].wall_ns) * 1e-9
    return AssemblyWindow(start_ns, end_ns, begun[-1].value if begun else None, result, phases, wall_s)


def workcell_of(recording: Recording) -> tuple[Workcell, dict[str, Any], str]:
    """(the cell's facts, its whole file as written, the part of it that is missing or "")."""
    text = recording.metadata.get("cell", {}).get("yaml")
    if text is None:
        return Workcell(), {}, "The cell's configuration: lengths are reckoned with the default drawings."
    try:
        content: Any = yaml_of(text) or {}
        return Workcell.model_validate(content.get("cell") or {}), content, ""
    except (yaml.YAMLError, ValidationError, AttributeError, OSError):
        return (
            Workcell(),
            {},
            "A cell's configuration that this version reads: lengths are reckoned with the default drawings.",
        )
