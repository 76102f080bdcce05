"""Makes untrusted text safe for a terminal or a log: one line without control characters."""

from __future__ import annotations

import json
from collections.abc import Iterator
from unicodedata import category

# control characters, changes of writing direction, zero-width characters, surrogates, line ends
_OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")
_LINES = "\n\r\t"


def _is_obeyed(character: str) -> bool:
    return category(character) in _OBEYED


def plain(text: str, most: int) -> str:
    r"""The text in one line of at most `most` characters; control characters are written as escapes, such as `\x1b`."""
    line = " ".join(text[: 4 * most].split())
    if not line.isprintable():
        line = "".join(one.encode("unicode_escape").decode() if _is_obeyed(one) else one for one in line)
    return line if len(line) <= most else line[: most - 3] + "..."


def is_plain_json(payload: bytes) -> bool:
    """Whether no string of a JSON text holds control characters for a terminal; line ends and tabs are allowed.

    Nearly all messages are ASCII without an escape; for these a scan of the bytes is enough.
    """
    escaped = b"\\" in payload and any(one in payload for one in (b"\\u", b"\\b", b"\\f"))
    if not escaped and payload.isascii() and b"\x7f" not in payload:
        return True
    try:
        return not any(_is_obeyed(one) and one not in _LINES for text in _texts(json.loads(payload)) for one in text)
    except (RecursionError, ValueError):  # nested too deep, or not JSON for Python
        return False


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield name
            yield from _texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner)
