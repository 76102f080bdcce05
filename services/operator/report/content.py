"""What the report shows, gathered from a recording. Whatever is missing is named, never made up."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import (
    ANNOTATED_LEFT,
    ANNOTATED_RIGHT,
    ASSEMBLE,
    CONTACT_WRENCH,
    ESTIMATE,
    EVENTS,
    NETWORK,
    PHASE,
    STATUS,
    TOUCH,
    TRUTH,
)
from crosspih_common.messages import (
    AssemblyPhase,
    AssemblyResult,
    Event,
    Image,
    Phase,
    PoseErrorEstimate,
    ServiceStatus,
    Severity,
    SimulationTruth,
    Touch,
    TouchUse,
)
from crosspih_common.plain_yaml import yaml_of
from crosspih_common.recording import Recording, Sent
from services.operator.scoring.score import TrialFigures, score


@dataclass(frozen=True, slots=True)
class Span:
    """One step of the assembly, s of cell time since its start."""

    message: AssemblyPhase
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class TouchEntry:
    """A touch, when it was, what was concluded from it, and what the last estimate thinks of it."""

    touch: Touch
    time_s: float
    estimate: PoseErrorEstimate | None
    use: TouchUse | None


@dataclass(slots=True)
class Content:
    """All that the page shows. `time_s` (n,) and `wrench` (n, 6) are the contact wrench over the assembly."""

    recording: Recording
    workcell: Workcell
    start_ns: int
    result: AssemblyResult | None
    truth: SimulationTruth | None
    figures: TrialFigures | None
    time_s: Array
    wrench: Array
    spans: list[Span] = field(default_factory=list)
    touches: list[TouchEntry] = field(default_factory=list)
    left: Image | None = None
    right: Image | None = None
    services: list[ServiceStatus] = field(default_factory=list)
    events: list[tuple[float, Event]] = field(default_factory=list)
    gaps: dict[str, int] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


def _workcell(recording: Recording, missing: list[str]) -> Workcell:
    text = recording.metadata.get("cell", {}).get("yaml")
    if text is None:
        missing.append("The cell's configuration: depths are computed with the default drawings.")
        return Workcell()
    try:
        content: Any = yaml_of(text) or {}
        return Workcell.model_validate(content.get("cell") or {})
    except (yaml.YAMLError, ValidationError, AttributeError):
        missing.append("A cell's configuration that this version reads: depths are computed with the default drawings.")
        return Workcell()


def _window(
    recording: Recording,
    requests: list[Sent[Any]],
    phases: list[AssemblyPhase],
    result: AssemblyResult | None,
) -> tuple[int, int]:
    """(start, end) of the assembly in cell time: from the command to its answer, or as near to that as is recorded."""
    first, last = recording.span_ns()
    end = result.stamp_ns if result is not None else last
    begun = [request.value.stamp_ns for request in requests if request.value.stamp_ns <= end]
    if begun:
        return begun[-1], end
    if phases:
        return phases[0].stamp_ns, end
    return first, end


def _touch_entries(recording: Recording, start_ns: int, end_ns: int) -> list[TouchEntry]:
    touches = [sent for sent in recording.sent(TOUCH) if start_ns <= sent.value.stamp_ns <= end_ns]
    answers = sorted(
        [*recording.sent(ESTIMATE.reply_echo), *recording.sent(NETWORK.reply_echo)], key=lambda sent: sent.wall_ns
    )
    uses = {use.index: use for use in answers[-1].value.rests_on} if answers else {}
    entries = []
    for number, sent in enumerate(touches):
        until = touches[number + 1].wall_ns if number + 1 < len(touches) else None
        after = [
            answer.value
            for answer in answers
            if answer.wall_ns >= sent.wall_ns and (until is None or answer.wall_ns < until)
        ]
        entries.append(
            TouchEntry(
                sent.value,
                (sent.value.stamp_ns - start_ns) * 1e-9,
                after[0] if after else None,
                uses.get(sent.value.index),
            )
        )
    return entries


def collect(recording: Recording) -> Content:
    """Everything for the page from a recording, whole or torn; of several assemblies the last."""
    missing: list[str] = []
    workcell = _workcell(recording, missing)
    requests = recording.sent(ASSEMBLE.request_echo)
    replies = recording.sent(ASSEMBLE.reply_echo)
    result = replies[-1].value if replies else None
    all_phases = recording.messages(PHASE)
    start_ns, end_ns = _window(recording, requests, all_phases, result)
    truth = recording.last(TRUTH)

    figures = None
    if result is not None:
        wall_s = (replies[-1].wall_ns - requests[-1].wall_ns) * 1e-9 if requests else 0.0
        figures = score(workcell, result, truth, wall_s=wall_s, recording=str(recording.path))

    samples = [sample for sample in recording.messages(CONTACT_WRENCH) if start_ns <= sample.stamp_ns <= end_ns]
    samples.sort(key=lambda sample: sample.stamp_ns)
    content = Content(
        recording=recording,
        workcell=workcell,
        start_ns=start_ns,
        result=result,
        truth=truth,
        figures=figures,
        time_s=np.array([(sample.stamp_ns - start_ns) * 1e-9 for sample in samples]),
        wrench=np.array([sample.wrench for sample in samples]).reshape(-1, 6),
        left=recording.last(ANNOTATED_LEFT),
        right=recording.last(ANNOTATED_RIGHT),
        gaps=recording.seq_gaps(),
        missing=missing,
    )
    phases = [phase for phase in all_phases if start_ns <= phase.stamp_ns <= end_ns and phase.phase is not Phase.IDLE]
    for index, phase in enumerate(phases):
        until_ns = phases[index + 1].stamp_ns if index + 1 < len(phases) else end_ns
        content.spans.append(Span(phase, (phase.stamp_ns - start_ns) * 1e-9, (until_ns - start_ns) * 1e-9))
    content.touches = _touch_entries(recording, start_ns, end_ns)
    by_service: dict[str, ServiceStatus] = {status.service: status for status in recording.messages(STATUS)}
    content.services = [by_service[name] for name in sorted(by_service)]
    content.events = [
        ((event.stamp_ns - start_ns) * 1e-9, event)
        for event in recording.messages(EVENTS)
        if event.severity is not Severity.INFO
    ]
    _name_what_is_missing(content)
    return content


def _name_what_is_missing(content: Content) -> None:
    say = content.missing.append
    for part in content.recording.parts:
        within = [str(damage) for damage in part.damage if not damage.torn]
        if within:
            say(f"What is damaged in {part.path.name} ({'; '.join(within)}). Everything before and behind it is here.")
        elif not part.finished:
            say(
                f"The end of {part.path.name}: the recorder was killed or the disk failed while it was being written "
                f"({part.tear}). Everything up to then is here."
            )
    for number, part in enumerate(content.recording.parts[1:], start=2):
        say(f"What was said before {part.path.name} began: the recorder had to begin again (part {number}).")
    if content.result is None:
        say("The result: the file ends before the assembly did, or no assembly was asked for while it ran.")
    if content.truth is None:
        say("The truth: without a simulator nothing tells the hole's true pose, so no errors are given.")
    if content.time_s.size == 0:
        say("The contact wrench: no sample of it lies within the assembly.")
    if not content.spans:
        say("The phases: planning told of none.")
    if content.left is None or content.right is None:
        say("The annotated pictures: vision sent none, or only one of the two.")
    if not content.services:
        say("The services' status.")
    for problem in content.recording.problems[:5]:
        say(f"A message that does not decode: {problem}")


__all__ = ["Content", "Span", "TouchEntry", "collect"]
