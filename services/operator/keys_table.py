"""`crosspih keys`: the key space, straight from its one table."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from crosspih_common.keys import ROOT, commands, topics


def keys() -> None:
    """Print every key: what travels, who sends it, who may read it."""
    table = Table(title=f"{ROOT}/<cell>/…", title_justify="left")
    for name in ("key", "message", "kind", "sent by", "read by", "Hz", "what"):
        table.add_column(name, no_wrap=name == "key")
    echoes = {f"{command.path}/{end}" for command in commands() for end in ("request", "reply")}
    for topic in topics():
        if topic.path in echoes:
            continue
        rate = "" if topic.rate_hz is None else f"{topic.rate_hz:g}"
        table.add_row(
            topic.path,
            topic.type.__name__,
            topic.kind.value,
            topic.publisher,
            ", ".join(topic.readers),
            rate,
            topic.doc,
        )
    for command in commands():
        table.add_row(
            command.path,
            f"{command.request.__name__} -> {command.reply.__name__}",
            "command",
            ", ".join(command.callers),
            command.server,
            "",
            command.doc,
        )
    Console().print(table)
