"""`crosspih topic echo`: the messages of a topic, decoded, as they come."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import CommandTimeout
from services.operator.cli.failure import errors_shown
from services.operator.topic.listening import TopicStream, each_sample, listening_bus
from services.operator.topic.names import TopicName
from services.operator.topic.naming import chosen_topic, shown
from services.operator.topic.values import as_json_line, as_yaml, field_of, plain_values, shortened

PARTED = "---\n"


def echo(
    name: TopicName,
    count: Annotated[int | None, typer.Option("--count", "-n", min=1, help="End after this many messages.")] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="End after so long; status 1 where nothing came meanwhile.")
    ] = None,
    field: Annotated[
        str | None, typer.Option(help="One field alone: wrench, pose_base_hole.position_m.0, samples.-1.")
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="Long lists in full; as JSON they always are.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One line of JSON a message.")] = False,
) -> None:
    """Print the messages of a topic as they come, as YAML; of a state the last one comes at once. Ctrl-C ends it."""
    told_by = Console(stderr=True)
    with errors_shown(told_by):
        chosen = chosen_topic(name)
        told = 0

        def enough() -> bool:
            return count is not None and told >= count

        def say(text: str) -> None:
            told_by.print(text, style="yellow", highlight=False, soft_wrap=True)

        with listening_bus() as bus:
            stream = TopicStream(bus, chosen)
            for heard in each_sample(stream, enough, seconds, say):
                payload = stream.decoded(heard)
                if isinstance(payload, str):
                    say(payload)
                    continue
                values = plain_values(payload)
                found = values if field is None else field_of(values, field)
                if as_json:
                    sys.stdout.write(as_json_line(found))
                else:
                    sys.stdout.write(as_yaml(found if full else shortened(found)) + PARTED)
                sys.stdout.flush()
                told += 1
            if stream.overflowed:
                say(f"{stream.overflowed} messages came faster than they could be shown, and were left out")
        if not told and seconds is not None:
            raise CommandTimeout(f"nothing came on {shown(chosen)} within {seconds:g} s")
