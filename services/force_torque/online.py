"""The online pipeline: a raw batch at a known orientation becomes one contact wrench. Pure: state in, state out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from crosspih_common.geometry.pose import Array, Pose
from services.force_torque.calibration import ToolParameters
from services.force_torque.compensation import (
    ContactEvent,
    FreeAirReport,
    FreeAirSettings,
    FreeAirState,
    LowPass,
    OnsetSettings,
    OnsetState,
    compensated,
    watch_free_air,
    watch_onset,
)


@dataclass(frozen=True, slots=True, eq=False)
class Pipeline:
    """Everything that the pipeline remembers between batches."""

    tool: ToolParameters
    low_pass: LowPass
    onset_settings: OnsetSettings
    free_settings: FreeAirSettings
    onset: OnsetState = field(default_factory=OnsetState)
    free: FreeAirState = field(default_factory=FreeAirState)
    pose_peg_sensor: Pose = field(default_factory=Pose.identity)

    def with_tool(self, tool: ToolParameters) -> Pipeline:
        """After a calibration: new parameters, and what was remembered of free air forgotten."""
        return replace(self, tool=tool, free=FreeAirState(), low_pass=replace(self.low_pass, last=None))


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What one batch gave: the filtered contact wrench (6,) at its end, contact, events, and the state of free air."""

    pipeline: Pipeline
    wrench: Array
    in_contact: bool
    events: list[ContactEvent]
    free_air: FreeAirReport


def step(
    pipeline: Pipeline, samples: Array, stamp_ns: int, period_ns: int, rotation_base_peg: Array, *, accelerating: bool
) -> Step:
    """Process a batch (n, 6), sensor frame, first sample at `stamp_ns`, at orientation (3, 3).

    While the arm is `accelerating` the payload's inertia is felt like a contact: then neither contact nor free air is
    judged, and both stay as they were.
    """
    mounting = pipeline.pose_peg_sensor
    contact = compensated(samples, rotation_base_peg @ mounting.rotation, pipeline.tool, mounting)
    stamps = stamp_ns + period_ns * np.arange(len(contact))
    low_pass, filtered = pipeline.low_pass.filtered(contact)
    if accelerating:
        onset, events = pipeline.onset, list[ContactEvent]()
    else:
        onset, events = watch_onset(pipeline.onset, pipeline.onset_settings, stamps, filtered)
    # an accelerating arm counts like a contact here: the samples just after it are left out too
    free, report = watch_free_air(pipeline.free, pipeline.free_settings, contact, onset.in_contact or accelerating)
    after = replace(pipeline, low_pass=low_pass, onset=onset, free=free)
    return Step(after, filtered[-1], onset.in_contact, events, report)
