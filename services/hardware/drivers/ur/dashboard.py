"""The dashboard server (port 29999): one question, one line."""

from __future__ import annotations

import socket
from collections.abc import Sequence

from crosspih_common.errors import DeviceLost

PORT = 29999


def ask(host: str, questions: Sequence[str], timeout_s: float) -> list[str]:
    """The answer to each question. Raises DeviceLost."""
    try:
        with socket.create_connection((host, PORT), timeout=timeout_s) as connection:
            lines = connection.makefile("rw", encoding="utf-8", newline="\n")
            lines.readline()  # its greeting
            answers = []
            for question in questions:
                lines.write(question + "\n")
                lines.flush()
                answers.append(lines.readline().strip())
            return answers
    except OSError as error:
        raise DeviceLost(
            f"no answer from the dashboard server of {host}:{PORT} ({error}); allow it under Settings, Security, "
            "Services on the pendant"
        ) from None
