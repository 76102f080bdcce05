"""The counts of `crosspih bench fuzz`, as tables for a terminal and as a page in Markdown."""

from __future__ import annotations

from dataclasses import dataclass, field

from rich.table import Table

from services.operator.bench.reliability.fuzz.attacking import AFTERWARDS, INTERNAL, NOTHING, AttackedPart
from services.operator.bench.reliability.fuzz.decoding_all import AllDecoded

DECODED = ("key", "accepted", "rejected", "any other error")
ASKED = ("command or topic", "sent", "accepted", "refused by name", "internal", "no answer", "other defects")


@dataclass
class Attacked:
    """The finished parts of an attack, and those whose cell was lost."""

    parts: list[AttackedPart] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    @property
    def defects(self) -> list[str]:
        """The defects of the cell, in words."""
        return [line for part in self.parts for line in part.told] + self.lost

    @property
    def grown_mb(self) -> dict[str, float]:
        """How much each service's memory grew between the end of the first part and that of the last."""
        if not self.parts:
            return {}
        first, last = self.parts[0].memory_mb, self.parts[-1].memory_mb
        return {name: round(now - first.get(name, now), 1) for name, now in last.items()}


def decoded_rows(decoded: AllDecoded) -> list[tuple[str, int, int, int]]:
    """(key, accepted, rejected, any other error)."""
    return [
        (row.key, row.accepted, row.rejected, sum(row.escaped.values())) for row in decoded.rows.values() if row.sent
    ]


def part_rows(attacked: Attacked) -> list[tuple[str, int, int, int, int, int, int]]:
    """In the order of ASKED."""
    rows = []
    for part in attacked.parts:
        if part.what == AFTERWARDS:
            continue
        counts = dict(part.answers)
        sent = part.samples or sum(counts.values())
        accepted, internal, nothing = (counts.pop(name, 0) for name in ("accepted", INTERNAL, NOTHING))
        others = len(part.told) - min(internal + nothing, len(part.defects))
        rows.append((part.what, sent, accepted, sum(counts.values()), internal, nothing, max(others, 0)))
    return rows


def _table(title: str, names: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    table = Table(title=title)
    for number, name in enumerate(names):
        table.add_column(name, justify="right" if number else "left")
    for row in rows:
        table.add_row(*row)
    return table


def decoded_table(decoded: AllDecoded) -> Table:
    """Key by key."""
    return _table("decoded, key by key", DECODED, [tuple(map(str, row)) for row in decoded_rows(decoded)])


def parts_table(attacked: Attacked) -> Table:
    """Command by command, then topic by topic; samples on a topic have no answer."""
    rows = [tuple(map(str, row)) for row in part_rows(attacked)]
    return _table("sent to a running cell", ASKED, rows)


def summary(decoded: AllDecoded, attacked: Attacked, defects: int) -> str:
    """A summary in one line."""
    keys = len(decoded_rows(decoded))
    sent = sum(row[1] for row in part_rows(attacked))
    after = next((part for part in attacked.parts if part.what == AFTERWARDS), None)
    told = "" if after is None else f", the assembly afterwards {'failed' if after.defects else 'inserted'}"
    return (
        f"{decoded.sent} payloads of {keys} keys decoded, {sent} sent to {len(attacked.parts) - (after is not None)} "
        f"commands and topics of a cell{told}; {defects} defects"
    )


def markdown(decoded: AllDecoded, attacked: Attacked, payloads: int, asked: int, seed: int) -> str:
    """The page `docs/fuzz.md`."""
    defects = sum(row[3] for row in decoded_rows(decoded)) + len(attacked.defects)
    text = [
        "# Malformed payloads",
        "",
        f"Made by `crosspih bench fuzz --payloads {payloads} --asked {asked} --seed {seed} --table docs/fuzz.md`. "
        "Payloads are drawn from each message's own JSON schema. A third fits it, with numbers as absurd as it allows. "
        "In a third a field is missing, strange, of another type or out of its range. A third is cut, flipped, "
        "doubled, nested without end or not JSON.",
        "",
        f"{summary(decoded, attacked, defects)}.",
        "",
    ]
    if decoded.sent:
        text += ["## Decoded, key by key", ""]
        text += [*_lines(DECODED, [tuple(map(str, row)) for row in decoded_rows(decoded)])]
        grown = f"{decoded.grown_mb:.1f} MB after each key's first share"
        text += [f"The memory of the decoding processes grew by at most {grown}.", ""]
    if attacked.parts:
        text += ["## Sent to a running cell", ""]
        text += ["Commands answer. A sample on a topic has no answer: it only must not make any service fail.", ""]
        text += _lines(ASKED, [tuple(map(str, row)) for row in part_rows(attacked)])
        grown = ", ".join(f"{name} {value:+.1f}" for name, value in attacked.grown_mb.items())
        text += [f"Memory growth between the first and the last payload, MB: {grown}.", ""]
    return "\n".join(text)


def _lines(names: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """A table in Markdown, and the blank line after it."""
    rule = "|".join(["---", *["---:"] * (len(names) - 1)])
    body = [f"| {' | '.join((f'`{row[0]}`', *row[1:]))} |" for row in rows]
    return [f"| {' | '.join(names)} |", f"|{rule}|", *body, ""]
