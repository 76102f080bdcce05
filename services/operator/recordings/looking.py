"""The content of a recording, and what is wrong with it. Pure, except for reading the file."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from crosspih_common.keys import topics
from crosspih_common.recording import Recording, parts_of, read_recording
from crosspih_common.recording.parts import part_number
from crosspih_common.recording.rerun import begun_ns


def described(path: Path) -> dict[str, Any]:
    """For `--json`: parts, channels, spans, drops, attachments. Times are s of cell time since the recording began.

    Raises RecordingError.
    """
    recording = read_recording(path)
    start_ns = begun_ns(recording)
    lines = recording.numbers()
    channels = []
    for key in sorted(recording.samples):
        samples, line = recording.samples[key], lines[key]
        stamps = [sample.stamp_ns for sample in samples]
        span_s = (max(stamps) - min(stamps)) * 1e-9
        channels.append(
            {
                "key": key,
                "type": recording.schemas[key][0],
                "encoding": recording.schemas[key][1],
                "messages": len(samples),
                "bytes": sum(len(sample.payload) for sample in samples),
                "rate_hz": (len(samples) - 1) / span_s if span_s > 0.0 else None,
                "first_s": (min(stamps) - start_ns) * 1e-9,
                "last_s": (max(stamps) - start_ns) * 1e-9,
                "missing": line.missing(),
                "restarts": line.restarts,
                "strays": line.strays,
            }
        )
    span = recording.span_ns()
    return {
        "path": str(path),
        "cell": recording.cell,
        "started": recording.metadata.get("recording", {}).get("started"),
        "finished": recording.finished,
        "duration_s": (span[1] - start_ns) * 1e-9 if recording.samples else 0.0,
        "messages": sum(len(samples) for samples in recording.samples.values()),
        "parts": [
            {
                "path": str(part.path),
                "bytes": part.size,
                "messages": part.messages,
                "finished": part.finished,
                "damage": [str(damage) for damage in part.damage],
                "attachments": [
                    {"name": one.name, "media_type": one.media_type, "bytes": len(one.data)} for one in part.attachments
                ],
            }
            for part in recording.parts
        ],
        "drops": {
            key: int(count)
            for key, count in recording.metadata.get("drops", {}).items()
            if count.isdigit() and count != "0" and "_total" not in key
        },
        "versions": recording.metadata.get("versions", {}),
        "metadata": sorted(recording.metadata),
        "channels": channels,
    }


@dataclass(frozen=True, slots=True)
class Finding:
    """A defect of a recording: a name for programs, and a text."""

    what: str
    file: str
    detail: str


def findings(path: Path) -> tuple[Recording, list[Finding]]:
    """The recording and everything that is wrong with it. Raises RecordingError where nothing can be read."""
    recording = read_recording(path)
    found = [finding for part in _of_files(recording) for finding in part]
    name = path.name
    for key, line in recording.numbers().items():
        if missing := line.missing():
            found.append(Finding("gap", name, f"{key}: {missing} samples never came"))
    for key, samples in recording.samples.items():
        back = [
            (after.stamp_ns, before.stamp_ns - after.stamp_ns)
            for before, after in pairwise(samples)
            if after.stamp_ns < before.stamp_ns and after.seq == before.seq + 1
        ]
        if back:
            most_s = max(by for _, by in back) * 1e-9
            found.append(Finding("back_in_time", name, f"{key}: stamps go back {len(back)} times, by {most_s:.3f} s"))
    drops = recording.metadata.get("drops", {})
    for kind in ("overflow", "unwritten", "malformed", "refused"):
        for key, count in drops.items():
            if key.startswith(f"{kind} "):
                found.append(Finding("dropped", name, f"{key.split(' ', 1)[1]}: {count} ({kind})"))
    before = len(recording.problems)
    for topic in topics():
        recording.sent(topic)
    undecoded = recording.problems[before:]
    if undecoded:
        found.append(Finding("undecodable", name, f"{len(undecoded)} messages, the first: {undecoded[0]}"))
    return recording, found


def _of_files(recording: Recording) -> list[list[Finding]]:
    found: list[list[Finding]] = []
    numbers = [part_number(file) for file in parts_of(recording.path)]
    missing = sorted(set(range(1, max(numbers) + 1)) - set(numbers)) if 1 in numbers else []
    found.append([Finding("missing_part", recording.path.name, f"part {number} is not there") for number in missing])
    for part in recording.parts:
        name = part.path.name
        here = [Finding("damaged", name, str(damage)) for damage in part.damage]
        if not part.finished and not part.damage:
            here.append(Finding("no_end", name, part.tear))
        if part.nameless:
            here.append(Finding("nameless", name, f"{part.nameless} messages whose key lay in what is damaged"))
        if part.declared is not None and not part.damage and part.declared != part.messages + part.nameless:
            said = f"its end says {part.declared} messages, {part.messages} are there"
            here.append(Finding("other_count", name, said))
        found.append(here)
    return found
