"""When samples that never came matter. Pure."""

from __future__ import annotations

from crosspih_common.keys import Kind

# of a stream that drops rather than waits a few samples may be missing: fewer than so many, or than this share
STREAM_SAMPLES, STREAM_SHARE = 10, 0.001


def gap_matters(kind: Kind | None, missing: int, heard: int) -> bool:
    """Whether people should be told that `missing` samples did not come beside `heard`: each event and state, and of a
    stream what cannot be put down to its dropping now and then."""
    if kind is not Kind.STREAM:
        return True
    return missing >= STREAM_SAMPLES and missing > STREAM_SHARE * (heard + missing)
