"""Decides which missing samples matter. Pure."""

from __future__ import annotations

from crosspih_common.keys import Kind

# a stream may drop a few samples without a warning: fewer than this number, or than this share
STREAM_SAMPLES, STREAM_SHARE = 10, 0.001


def gap_matters(kind: Kind | None, missing: int, heard: int) -> bool:
    """Whether to warn that `missing` samples are absent beside `heard` received ones: always for events and states, and
    for a stream if it is more than an occasional drop."""
    if kind is not Kind.STREAM:
        return True
    return missing >= STREAM_SAMPLES and missing > STREAM_SHARE * (heard + missing)
