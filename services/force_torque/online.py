"""The online pipeline: a raw batch at a known orientation becomes one contact wrench. Pure: state in, state out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.wrench import LowPass, Payload
from services.force_torque.compensation import (
    ContactEvent,
    FreeAirReport,
    FreeAirSettings,
    FreeAirState,
    OnsetSettings,
    OnsetState,
    watch_free_air,
    watch_onset,
)


@dataclass(frozen=True, slots=True, eq=False)
class Pipeline:
    """The pipeline's state between batches."""

    payload: Payload
    low_pass: LowPass
    onset_settings: OnsetSettings
    free_settings: FreeAirSettings
    onset: OnsetState = field(default_factory=OnsetState)
    free: FreeAirState = field(default_factory=FreeAirState)

    def with_payload(self, payload: Payload) -> Pipeline:
        """The pipeline after a calibration: the new payload, with the free-air memory cleared."""
        return replace(self, payload=payload, free=FreeAirState(), low_pass=replace(self.low_pass, last=None))


@dataclass(frozen=True, slots=True, eq=False)
class PipelineStep:
    """The result of one batch: the filtered contact wrench (6,) at its end, contact, events, and the free-air state."""

    pipeline: Pipeline
    wrench: Array
    in_contact: bool
    events: list[ContactEvent]
    free_air: FreeAirReport


def step(
    pipeline: Pipeline,
    samples: Array,
    stamp_ns: int,
    period_ns: int,
    rotation_base_peg: Array,
    *,
    accelerating: bool,
    may_touch: bool,
) -> PipelineStep:
    """Process a batch (n, 6) of raw sensor values, first sample at `stamp_ns`, at orientation (3, 3).

    While the arm is `accelerating`, the payload's inertia looks like a contact. Then neither contact nor free air is
    evaluated, and both keep their state. If the peg `may_touch` the hole's part, too lightly to be noticed, no sample
    counts as free air.
    """
    contact, period_s = pipeline.payload.contact(samples, rotation_base_peg), period_ns * 1e-9
    stamps = stamp_ns + period_ns * np.arange(len(contact))
    low_pass, filtered = pipeline.low_pass.at_period(period_s).filtered(contact)
    if accelerating:
        onset, events = pipeline.onset, list[ContactEvent]()
    else:
        onset, events = watch_onset(pipeline.onset, pipeline.onset_settings, stamps, filtered, period_s)
    # an accelerating arm is treated like a contact: the samples just after it are left out too
    disturbed = onset.in_contact or accelerating or may_touch
    free, report = watch_free_air(pipeline.free, pipeline.free_settings, contact, disturbed, period_s)
    after = replace(pipeline, low_pass=low_pass, onset=onset, free=free)
    return PipelineStep(after, filtered[-1], onset.in_contact, events, report)
