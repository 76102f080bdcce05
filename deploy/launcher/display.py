"""How the launcher looks in a terminal: coloured interleaved logs and the table of ``crosspih ps``."""

import zlib
from collections.abc import Collection, Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from deploy.launcher.conditions import ServicePhase, describe_exit
from deploy.launcher.health import Health
from deploy.launcher.logfile import LogLine
from deploy.launcher.state import ServiceRow, StackState, Stopped

_COLOURS = ("cyan", "yellow", "green", "magenta", "blue", "bright_red", "bright_cyan", "bright_yellow", "bright_green")
_PHASE_STYLE = {
    ServicePhase.RUNNING: "green",
    ServicePhase.RESTARTING: "yellow",
    ServicePhase.WAITING: "yellow",
    ServicePhase.BLOCKED: "red",
}
_HEALTH_STYLE = {Health.HEALTHY: "green", Health.UNHEALTHY: "red", Health.STARTING: "yellow"}


class TerminalConsole(Console):
    """A console that lets the caller know when its reader has gone, where rich would end the whole program."""

    def on_broken_pipe(self) -> None:
        """Show nothing from now on, and raise BrokenPipeError once."""
        self.quiet = True
        raise BrokenPipeError


class LogView:
    """Prints log lines as ``service | text``, each service in a colour of its own, aligned over ``services``."""

    def __init__(self, console: Console, services: Collection[str]) -> None:
        self._console = console
        self._width = max((len(name) for name in services), default=0)
        self._colours = {name: _COLOURS[index % len(_COLOURS)] for index, name in enumerate(sorted(services))}

    def show(self, line: LogLine) -> None:
        """Print one line; colours that the service itself wrote are kept. Raises OSError if the terminal has gone."""
        # A service that appears later still gets the same colour each time; hash() differs between processes.
        colour = self._colours.setdefault(line.service, _COLOURS[zlib.crc32(line.service.encode()) % len(_COLOURS)])
        text = Text.assemble((f"{line.service:<{self._width}} | ", colour), Text.from_ansi(line.text))
        self._console.print(text, soft_wrap=True, highlight=False)


def services_table(state: StackState) -> Table:
    """The table of ``crosspih ps``."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("SERVICE", "STATE", "HEALTH", "PID", "RESTARTS", "SINCE (UTC)", "NOTE"):
        numeric = heading in ("PID", "RESTARTS")
        table.add_column(heading, justify="right" if numeric else "left", no_wrap=heading != "NOTE", overflow="fold")
    for row in state.services:
        table.add_row(
            row.service,
            Text(_phase_text(row), style=_PHASE_STYLE.get(row.phase, "red" if row.exit_code else "")),
            Text("" if row.health is Health.NONE else row.health.value, style=_HEALTH_STYLE.get(row.health, "")),
            str(row.pid or ""),
            str(row.restarts),
            row.since[:19].replace("T", " "),
            Text(row.note),
        )
    return table


def stopped_lines(stopped: Sequence[Stopped], spent_s: float) -> list[str]:
    """What `crosspih down` says: a line a service, and one for all."""
    if not stopped:
        return ["stopped; its supervisor did not end in time and was killed, and so were the services"]
    width = max(len(one.service) for one in stopped)
    lines = [
        f"{one.service:<{width}}  {'killed: it did not end' if one.killed else 'ended'} after {one.seconds:.2f} s"
        for one in stopped
    ]
    killed = sum(one.killed for one in stopped)
    ends = f"{len(stopped) - killed} ended" + (f", {killed} killed" if killed else "")
    return [*lines, f"the stack is down after {spent_s:.1f} s: {ends}"]


def _phase_text(row: ServiceRow) -> str:
    if row.phase is ServicePhase.EXITED and row.exit_code is not None:
        return f"{row.phase.value} ({describe_exit(row.exit_code)})"
    return row.phase.value
