"""What `crosspih --version` prints: enough to see whether two machines have the same contract, and for a bug report."""

from __future__ import annotations

import hashlib
import platform
from importlib import metadata

from crosspih_common.bus.codec import label_of
from crosspih_common.keys import Command, Topic, commands, topics

SHORT = 12


def contract() -> tuple[int, str]:
    """The number of message types, and a hash of all that two ends must agree on: each key with the name and version of
    its type, and the JSON Schema of each type.
    """
    ends: list[Topic[object] | Command[object, object]] = [*topics(), *commands()]  # type: ignore[type-var]
    kinds: dict[str, object] = {}
    lines = []
    for end in ends:
        types = (end.type,) if isinstance(end, Topic) else (end.request, end.reply)
        for kind in types:
            schema = getattr(kind, "model_json_schema", None)  # a picture is a Foxglove message, known by its label
            kinds[label_of(kind)] = schema() if schema else None
        lines.append(f"{end.path} {' '.join(label_of(kind) for kind in types)}")
    text = repr((sorted(lines), sorted((label, repr(schema)) for label, schema in kinds.items())))
    return len(kinds), hashlib.sha256(text.encode()).hexdigest()[:SHORT]


def _installed(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def version_lines() -> list[str]:
    """A line a part."""
    count, code = contract()
    return [
        f"crosspih  {_installed('crosspih')}",
        f"messages  {count} types, contract {code}: alike where two machines understand each other",
        f"Python    {platform.python_version()}",
        f"Zenoh     {_installed('eclipse-zenoh')}",
    ]
