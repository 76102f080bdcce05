"""`crosspih keys`: the key space, straight from its one table."""

from __future__ import annotations

from crosspih_common.keys import ROOT, commands, topics

HEADINGS = ("key", "message", "kind", "sent by", "read by", "Hz", "what")


def rows() -> list[tuple[str, ...]]:
    """One row a key, in `HEADINGS` order; the echoes of commands are left out."""
    echoes = {f"{command.path}/{end}" for command in commands() for end in ("request", "reply")}
    table: list[tuple[str, ...]] = [
        (
            topic.path,
            topic.type.__name__,
            topic.kind.value,
            topic.publisher,
            ", ".join(topic.readers),
            "" if topic.rate_hz is None else f"{topic.rate_hz:g}",
            topic.doc,
        )
        for topic in topics()
        if topic.path not in echoes
    ]
    table += [
        (
            command.path,
            f"{command.request.__name__} -> {command.reply.__name__}",
            "command",
            ", ".join(command.callers),
            command.server,
            "",
            command.doc,
        )
        for command in commands()
    ]
    return table


def markdown() -> str:
    """The table as a page of the documentation."""
    lines = [
        "# Keys",
        "",
        f"Every key below `{ROOT}/<cell>/`. Made by `crosspih keys --markdown` from `crosspih_common/keys.py`; a test",
        "holds it to that table. A command is a query on its key; its server repeats what it was asked on",
        "`<key>/request` and what it answered on `<key>/reply`. Beside each payload travels `type/version seq`.",
        "",
        "| " + " | ".join(HEADINGS) + " |",
        "|" + "---|" * len(HEADINGS),
    ]
    lines += ["| " + " | ".join([f"`{row[0]}`", f"`{row[1]}`", *row[2:]]) + " |" for row in rows()]
    return "\n".join(lines) + "\n"
