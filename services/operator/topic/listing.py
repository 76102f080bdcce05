"""`crosspih topic list`: the table of topics, and whether their senders are running."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.config import cell_name
from crosspih_common.errors import BusError
from crosspih_common.keys import ROOT, Topic, commands, topics
from crosspih_common.topic_names import EVERY_SERVICE
from services.operator.cell.which_cell import cell_path
from services.operator.cli.failure import errors_shown
from services.operator.cli.options import AsJson
from services.operator.topic.listening import alive_services, listening_bus
from services.operator.topic.naming import shown


def rows_of(alive: set[str] | None, every: bool = False) -> list[dict[str, Any]]:
    """One row per topic; the echoes of commands' requests and replies only with `every`.

    `alive`: the services with a liveliness token, None where nobody could be asked. Pure.
    """
    echoes = {f"{command.path}/{end}" for command in commands() for end in ("request", "reply")}
    return [_row(topic, alive) for topic in topics() if every or topic.path not in echoes]


def _row(topic: Topic[Any], alive: set[str] | None) -> dict[str, Any]:
    many = topic.publisher == EVERY_SERVICE
    lives = None if alive is None else bool(alive) if many else topic.publisher in alive
    return {
        "key": shown(topic), "type": topic.type.__name__, "kind": topic.kind.value,
        "rate_hz": topic.rate_hz, "sent_by": "every service" if many else topic.publisher, "alive": lives,
        "what": topic.doc,
    }  # fmt: skip


def _table(rows: Iterable[dict[str, Any]], title: str) -> Table:
    table = Table(title=title, title_justify="left")
    for name in ("key", "type", "kind", "Hz", "sent by", "alive", "what"):
        table.add_column(name, no_wrap=name == "key", justify="right" if name == "Hz" else "left")
    for row in rows:
        lives = {None: "", True: "[green]yes[/green]", False: "[red]no[/red]"}[row["alive"]]
        rate = "" if row["rate_hz"] is None else f"{row['rate_hz']:g}"
        table.add_row(row["key"], row["type"], row["kind"], rate, row["sent_by"], lives, row["what"])
    return table


def list_topics(
    every: Annotated[
        bool, typer.Option("--all", help="Also what services repeat of commands that they were asked.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """All topics: key, type, who sends it, and whether that service is alive now."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        alive: set[str] | None = None
        why = ""
        try:
            with listening_bus() as bus:
                senders = frozenset(topic.publisher for topic in topics()) - {EVERY_SERVICE}
                alive = alive_services(bus, senders)
        except BusError as error:
            why = str(error)
        rows = rows_of(alive, every)
        if as_json:
            json.dump(rows, sys.stdout, indent=1)
            print()
        else:
            console.print(_table(rows, f"{ROOT}/{cell_name(cell_path())}/…"))
        if why:
            Console(stderr=True).print(f"nobody could be asked who is alive: {why}", style="yellow", highlight=False)
