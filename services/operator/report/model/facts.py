"""All content of a report, gathered once from a recording: tiles, charts and tables only show these facts.

Pure, except for reading. Missing data is named as missing, never replaced.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.keys import ANNOTATED_LEFT, ANNOTATED_RIGHT, LOCATE, TRUTH
from crosspih_common.messages import HoleEstimate, Image, SimulationTruth
from crosspih_common.recording import Recording
from services.operator.report.model.checks import Check, checks_of
from services.operator.report.model.forces import Forces, forces_of
from services.operator.report.model.health import RecordingHealth, health_of
from services.operator.report.model.motion import (
    AnsweredMotion,
    JointTrace,
    JointUse,
    joint_uses,
    joints_of,
    motions_of,
)
from services.operator.report.model.phases import PhaseTime, Span, calibrated_until_s, spans_of, times_of
from services.operator.report.model.poses import HolePose, poses_of, reference_hole
from services.operator.report.model.touches import TouchEntry, touches_of
from services.operator.report.model.window import AssemblyWindow, window_of, workcell_of
from services.operator.scoring.score import TrialFigures, score


@dataclass(slots=True, eq=False)
class Facts:
    """See the modules that make each part. `reference` is the hole in whose frame the tip's path is given."""

    recording: Recording
    workcell: Workcell
    configuration: dict[str, Any]
    window: AssemblyWindow
    truth: SimulationTruth | None
    figures: TrialFigures | None
    located: HoleEstimate | None
    left: Image | None
    right: Image | None
    spans: list[Span]
    times: list[PhaseTime]
    calibrated_s: float
    motions: list[AnsweredMotion]
    joints: JointTrace | None
    uses: list[JointUse]
    reference: Pose
    reference_name: str
    forces: Forces
    touches: list[TouchEntry]
    presses: list[TouchEntry]
    poses: list[HolePose]
    health: RecordingHealth
    checks: list[Check] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    @property
    def outline(self) -> str:
        """The name of the peg's section, such as cross or star."""
        return self.workcell.peg.shape().outline.name

    @property
    def end_s(self) -> float:
        """When the assembly was over, s of cell time since its command."""
        return self.window.s(self.window.end_ns)


def facts_of(recording: Recording) -> Facts:
    """The facts of a recording, complete or torn; with several assemblies those of the last."""
    workcell, configuration, lacks = workcell_of(recording)
    window = window_of(recording)
    result = window.result
    truth = recording.last(TRUTH)
    figures = None
    if result is not None:
        figures = score(workcell, result, truth, wall_s=window.wall_s or 0.0, recording=str(recording.path))
    spans = spans_of(window)
    calibrated_s = calibrated_until_s(spans)
    motions = motions_of(recording, window)
    joints = joints_of(recording, window, workcell, calibrated_s)
    reference, reference_name = reference_hole(workcell, result)
    forces = forces_of(recording, window, workcell, joints, motions, reference, calibrated_s)
    touches, presses = touches_of(recording, window, motions, forces.filtered or forces.main)
    located = [estimate for estimate in recording.messages(LOCATE.reply_echo) if window.holds(estimate.stamp_ns)]
    seen = (recording.last(ANNOTATED_LEFT), recording.last(ANNOTATED_RIGHT))
    left, right = (image if image is not None and window.holds(image.stamp_ns) else None for image in seen)
    facts = Facts(
        recording=recording,
        workcell=workcell,
        configuration=configuration,
        window=window,
        truth=truth,
        figures=figures,
        located=located[-1] if located else None,
        left=left,
        right=right,
        spans=spans,
        times=times_of(spans),
        calibrated_s=calibrated_s,
        motions=motions,
        joints=joints,
        uses=joint_uses(joints, workcell) if joints is not None else [],
        reference=reference,
        reference_name=reference_name,
        forces=forces,
        touches=touches,
        presses=presses,
        poses=poses_of(workcell, result, truth),
        health=health_of(recording, window),
    )
    true_depth_mm = None if truth is None or figures is None else figures.insertion_depth_mm
    facts.checks = checks_of(result, len(touches), len(presses), forces, motions, true_depth_mm)
    facts.missing = [lacks] if lacks else []
    _name_what_is_missing(facts)
    return facts


def _name_what_is_missing(facts: Facts) -> None:
    say = facts.missing.append
    recording = facts.recording
    for part in recording.parts:
        within = [str(damage) for damage in part.damage if not damage.torn]
        if within:
            say(f"What is damaged in {part.path.name} ({'; '.join(within)}). Everything before and behind it is here.")
        elif not part.finished:
            say(
                f"The end of {part.path.name}: the recorder was killed or the disk failed while it was being written "
                f"({part.tear}). Everything up to then is here."
            )
    for number, part in enumerate(recording.parts[1:], start=2):
        say(f"What was said before {part.path.name} began: the recorder had to begin again (part {number}).")
    if facts.window.result is None:
        say("The result: the file ends before the assembly did, or no assembly was asked for while it ran.")
    if facts.truth is None:
        say("The truth: without a simulator nothing tells the hole's true pose, so no errors are given.")
    if facts.forces.main is None:
        say("The contact wrench: no sample of it lies within the assembly.")
    elif facts.forces.unfiltered is None:
        say("The sensor's own samples, or the calibration to read them: only filtered forces are shown.")
    if facts.joints is None:
        say("The encoders: no trajectory can be shown.")
    if not facts.spans:
        say("The phases: planning published none.")
    asked = facts.figures is None or (facts.figures.looked and not facts.figures.vision_refused)
    if asked and (facts.left is None or facts.right is None):
        say("The annotated pictures: vision sent none, or only one of the two.")
    if not facts.health.services:
        say("The services' status.")
    for problem in recording.problems[:5]:
        say(f"A message that does not decode: {problem}")
