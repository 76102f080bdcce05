"""The requests and answers in a recording, command by command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from crosspih_common.keys import (
    ADVISE_INSERTION,
    CAPTURE,
    CLOCK,
    ESTIMATE,
    LOCATE,
    NETWORK,
    NEXT_TOUCH,
    REFUSAL,
    SEATED,
    SEQUENCE_NETWORK,
    Command,
    Topic,
)
from crosspih_common.messages import Message
from crosspih_common.recording import OVERTAKEN_NS, Recording
from crosspih_common.recording.rerun import begun_ns

# services whose answers depend only on the request and, for vision, on the pictures that it then takes
COMMANDS: dict[str, tuple[Command[Any, Any], ...]] = {
    "vision": (LOCATE,),
    "inference": (ESTIMATE, NEXT_TOUCH, SEATED, NETWORK, SEQUENCE_NETWORK, ADVISE_INSERTION),
}
TOPICS: tuple[Topic[Any], ...] = (
    CLOCK,
    REFUSAL,
    *(echo for command in (CAPTURE, *COMMANDS["vision"], *COMMANDS["inference"])
      for echo in (command.request_echo, command.reply_echo)),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PastRequest:
    """One request and its answer; None where none is recorded: it was refused, or the recording ended before.

    `at_s` is the cell's time of the request since the recording began. `first_pair_s` is that of the first picture pair
    taken for the answer, `pairs` the number of pairs; None and 0 where there was none or no answer tells.
    """

    command: Command[Any, Any]
    at_s: float
    request: Message
    answer: Message | None
    first_pair_s: float | None = None
    pairs: int = 0


def requests_of(recording: Recording, service: str, from_s: float) -> list[PastRequest]:
    """The requests to a service from this time on, in order.

    Pictures belong to a request when they came after the previous answer and not after its own.
    """
    start_ns = begun_ns(recording)
    pairs = recording.sent(CAPTURE.reply_echo)
    found: list[tuple[int, PastRequest]] = []
    for command in COMMANDS[service]:
        before_ns = 0
        for request, reply in recording.answered(command):
            at_s = (request.value.stamp_ns - start_ns) * 1e-9
            since_ns = max(before_ns + 1, request.wall_ns - OVERTAKEN_NS)
            ended_ns = None if reply is None else reply.wall_ns
            taken = [pair.value for pair in pairs if since_ns <= pair.wall_ns and ended_ns and pair.wall_ns <= ended_ns]
            before_ns = max(before_ns, request.wall_ns if ended_ns is None else ended_ns)
            if at_s >= from_s:
                first_s = (taken[0].stamp_ns - start_ns) * 1e-9 if taken else None
                answer = None if reply is None else reply.value
                found.append((request.wall_ns, PastRequest(command, at_s, request.value, answer, first_s, len(taken))))
    return [asked for _, asked in sorted(found, key=lambda entry: entry[0])]
