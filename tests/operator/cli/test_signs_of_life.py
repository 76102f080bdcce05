"""What `crosspih ps` notes of a service that hangs before the launcher can know."""

from __future__ import annotations

import pytest

from deploy.launcher.conditions import ServicePhase
from deploy.launcher.health import Health
from deploy.launcher.state import ServiceRow, StackState
from services.operator.cli.ps import SILENT, noted, with_clock


def row(service: str, phase: ServicePhase = ServicePhase.RUNNING, health: Health = Health.HEALTHY) -> ServiceRow:
    return ServiceRow(
        service=service, phase=phase, health=health, pid=1, exit_code=None, restarts=0, since="2026-01-01", note=""
    )


def notes(*rows: ServiceRow, alive: set[str]) -> dict[str, str]:
    state = StackState(
        project="p", compose_file="", supervisor_pid=1, since="2026-01-01", finished=False, services=rows
    )
    return {found.service: found.note for found in noted(state, alive).services if found.note}


@pytest.mark.parametrize("service", ["planning", "recorder"])
def test_one_that_hangs_is_named(service: str) -> None:
    rows = (row("router"), row("vision"), row(service))
    assert notes(*rows, alive={"vision"}) == {service: SILENT}
    assert notes(*rows, alive={"vision", service}) == {}


def test_what_the_launcher_knows_of_is_not_said_again() -> None:
    rows = (row("vision"), row("planning", health=Health.STARTING), row("recorder", phase=ServicePhase.RESTARTING))
    assert notes(*rows, alive={"vision"}) == {}


def test_of_another_cell_nothing_is_said() -> None:
    assert notes(row("vision"), row("planning"), alive={"their_vision"}) == {}


def test_clocks_that_are_apart_are_noted_at_the_router() -> None:
    state = StackState(
        project="p", compose_file="", supervisor_pid=1, since="2026-01-01", finished=False,
        services=(row("router"), row("vision")),
    )  # fmt: skip
    told = {found.service: found.note for found in with_clock(state, "100 ms ahead").services}
    assert told == {"router": "100 ms ahead", "vision": ""}
    assert with_clock(state, "") == state
