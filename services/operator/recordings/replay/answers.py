"""The service itself, as a process on a separate router, gets the requests of the recording again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crosspih_common.config import with_files_beside
from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.messages import Message
from crosspih_common.plain_yaml import MAX_BYTES, text_of_file, yaml_of
from crosspih_common.recording import Recording
from crosspih_common.recording.comparing import FieldDifference, differences
from services.operator.assembly.session import Session
from services.operator.bench.cells.own_cell import CellTask, OwnCell
from services.operator.recordings.replay.requests import PastRequest

DEADLINE_S = 300.0
_BEFORE_S = 1e-4  # so that the time to start from is before the picture's own stamp


@dataclass(frozen=True, slots=True)
class Compared:
    """One repeated request. `refused` is the refusal now, where there is no answer."""

    asked: PastRequest
    refused: str
    differences: tuple[FieldDifference, ...]

    @property
    def equal(self) -> bool:
        """Whether the answer is the same, or missing both times."""
        return not self.differences


def stored_cell(recording: Recording, cell: Path | None) -> dict[str, Any]:
    """The content of the cell's file in the recording, or of another one; paths in it are absolute.

    Raises ConfigError where there is none.
    """
    if cell is None:
        stored = recording.metadata.get("cell", {})
        if "yaml" not in stored:
            raise ConfigError(f"{recording.path}: does not hold its cell's file; name one with --cell")
        path, text = Path(stored.get("path", "cell.yaml")), stored["yaml"]
    else:
        try:
            path, text = cell.resolve(), text_of_file(cell, MAX_BYTES)
        except OSError as error:
            raise ConfigError(f"--cell {cell}: cannot be read ({error.strerror})") from None
    content = yaml_of(text) or {}
    return {**content, "cell": with_files_beside(path, content.get("cell") or {})}


def answers(
    service: str, content: dict[str, Any], recording: Recording, requests: list[PastRequest]
) -> Iterator[Compared]:
    """Repeats each request to the service; vision's camera gives the recorded pictures.

    Raises CrosspihError or LauncherError when the service does not start.
    """
    own = _Own(service, content, recording.path)
    try:
        for asked in requests:
            yield _compared(own.session_for(asked), asked, own.answered)
    finally:
        own.close()


def _compared(session: Session, asked: PastRequest, on_answer: Callable[[Message | None], None]) -> Compared:
    refused, answer = "", None
    try:
        answer = session.bus.call(asked.command, asked.request, DEADLINE_S)
    except CommandRefused as refusal:
        refused = str(refusal)
    on_answer(answer)
    if asked.answer is None or answer is None:
        same = asked.answer is None and answer is None
        then, now = ("none is recorded" if asked.answer is None else "given"), refused or "given"
        return Compared(asked, refused, () if same else (FieldDifference("answer", then, now, None),))
    return Compared(asked, refused, tuple(differences(asked.answer, answer)))


class _Own:
    """The stack. Its camera gives one recorded pair after the other. If the next pair is not the one that a request
    needs, because it was for something else or because vision now takes more pictures, the stack is started anew at
    that pair.
    """

    def __init__(self, service: str, content: dict[str, Any], file: Path) -> None:
        self._service, self._content, self._file = service, content, file
        self._cell: OwnCell | None = None
        self._session: Session | None = None
        self._in_order = False
        self._asked: PastRequest | None = None

    def session_for(self, asked: PastRequest) -> Session:
        """A session on the stack, ready for that request."""
        pictures = self._service == "vision"
        if self._session is None or (pictures and not self._in_order):
            self.close()
            content = dict(self._content)
            services: tuple[str, ...] = (self._service,)
            if pictures:
                begin_s = asked.at_s if asked.first_pair_s is None else asked.first_pair_s
                content["hardware"] = {
                    "driver": "recorded",
                    "devices": ["camera"],
                    "recorded": {
                        "file": str(self._file.resolve()), "from_s": max(0.0, begin_s - _BEFORE_S), "torn": True,
                    },
                }  # fmt: skip
                services = ("hardware", self._service)
            task = CellTask("replay", content, _nothing, None, services, calibrate=False, speed="")
            self._cell = OwnCell(0, task)
            self._session = self._cell.start()
        self._asked = asked
        return self._session

    def answered(self, answer: Message | None) -> None:
        """Notes whether the camera now is at the same pair as the recorded one after this answer: as many pictures were
        taken.
        """
        looks = getattr(answer, "diagnostics", {}).get("looks")
        self._in_order = self._asked is not None and looks is not None and round(looks) == self._asked.pairs

    def close(self) -> None:
        """End the stack; a second call does nothing."""
        if self._cell is not None:
            self._cell.close()
        self._cell = self._session = None


def _nothing(session: Session, payload: Any) -> None:
    """A task without work: the stack is used from outside."""
