"""When missing samples of a recording matter, and the warnings about them. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from crosspih_common.keys import Kind
from crosspih_common.recording.gaps import gap_matters

STRAYS = 10  # each publisher that was started again and had sent one sample leaves one stray
CODES = ("samples_dropped", "samples_missing", "samples_rejected", "numbers_in_doubt")


def warnings_of(counts: Mapping[str, Mapping[str, int]], kinds: Mapping[str, Kind]) -> dict[str, str]:
    """The warnings as event codes and texts; `counts` is as the tally gives them, `kinds` is the kind of each key."""
    found: dict[str, str] = {}
    dropped = _added(counts["overflow"], counts["unwritten"])
    if dropped:
        text = f"{_samples(dropped)} did not get into the recording: the disk or this machine was too slow or full"
        found["samples_dropped"] = f"{text}{_most(dropped)}"
    heard = counts["heard"]
    gaps = {
        key: count for key, count in counts["gaps"].items() if gap_matters(kinds.get(key), count, heard.get(key, 0))
    }
    if gaps:
        found["samples_missing"] = f"{_samples(gaps)} never came here over the bus{_most(gaps)}"
    rejected = _added(counts["malformed"], counts["refused"])
    if rejected:
        text = f"{_samples(rejected)} were not what their key promises, and are not in the recording"
        found["samples_rejected"] = f"{text}{_most(rejected)}"
    strays = {key: count for key, count in counts["strays"].items() if count >= STRAYS}
    if strays:
        text = f"{_samples(strays)} carry numbers that follow from none: a second publisher on the key?"
        found["numbers_in_doubt"] = f"{text}{_most(strays)}"
    return found


def _added(*counts: Mapping[str, int]) -> dict[str, int]:
    total: dict[str, int] = {}
    for each in counts:
        for key, count in each.items():
            total[key] = total.get(key, 0) + count
    return total


def _samples(counts: Mapping[str, int]) -> str:
    total = sum(counts.values())
    return "1 sample" if total == 1 else f"{total} samples"


def _most(counts: Mapping[str, int]) -> str:
    key = max(sorted(counts), key=counts.__getitem__)
    below = "/".join(key.split("/")[2:]) or key
    return f" ({below})" if len(counts) == 1 else f" (most of {below}: {counts[key]}; of {len(counts)} keys in all)"
