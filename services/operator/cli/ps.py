"""`crosspih ps`: the launcher's table. For each service it adds whether the bus has its liveliness token, and at the
router whether this machine's wall clock agrees with that of the cell's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from crosspih_common.errors import CrosspihError
from deploy.launcher.conditions import ServicePhase
from deploy.launcher.health import Health
from deploy.launcher.looking import Project, RunDir, show_stack
from deploy.launcher.state import DEFAULT_PROJECT, StackState
from services.operator.cell.which_cell import cell_path, endpoint
from services.operator.cli.options import AsJson

if TYPE_CHECKING:
    from crosspih_common.bus import Bus

CONNECT_S = 1.0
HEAR_S = 1.0
CLOCK_ASKED, CLOCK_ASK_S = 3, 1.0
ROUTER = "router"  # the router has no token, but without a router nobody has one
SILENT = "no sign of life on the bus: it hangs"


def noted(state: StackState, alive: set[str]) -> StackState:
    """The state, with a note at each service that the launcher calls healthy but that has no token among `alive`.

    Nothing is noted where no service has a token: then the tokens are another cell's.
    """
    if not alive & {row.service for row in state.services}:
        return state
    rows = [
        row.model_copy(update={"note": "; ".join(filter(None, (row.note, SILENT)))})
        if row.service not in alive | {ROUTER} and row.phase is ServicePhase.RUNNING and row.health is Health.HEALTHY
        else row
        for row in state.services
    ]
    return state.model_copy(update={"services": tuple(rows)})


def with_clock(state: StackState, apart: str) -> StackState:
    """The state, with a note at the router where the clocks of the two machines differ."""
    rows = [
        row.model_copy(update={"note": "; ".join(filter(None, (row.note, apart)))}) if row.service == ROUTER else row
        for row in state.services
    ]
    return state.model_copy(update={"services": tuple(rows)})


def _clocks_apart(bus: Bus) -> str:
    from crosspih_common.service.wall_clock import APART_S, measured

    wall = measured(bus, CLOCK_ASKED, CLOCK_ASK_S)
    return str(wall) if wall is not None and wall.least_s > APART_S else ""


def _with_signs_of_life(state: StackState) -> StackState:
    from crosspih_common.bus import Bus, open_zenoh  # imports the messages: not for a stack that is down
    from crosspih_common.config import cell_name
    from services.operator.topic.listening import alive_services

    wanted = frozenset(row.service for row in state.services if row.phase is ServicePhase.RUNNING) - {ROUTER}
    try:
        with Bus(open_zenoh(endpoint(), CONNECT_S), cell_name(cell_path()), "operator") as bus:
            return with_clock(noted(state, alive_services(bus, wanted, HEAR_S)), _clocks_apart(bus))
    except CrosspihError:
        return state  # no router, or no cell's file: print only the launcher's own table


def ps(
    as_json: AsJson = False,
    project: Project = DEFAULT_PROJECT,
    run_dir: RunDir = None,
) -> None:
    """Show the services, their health and restarts, which have no sign of life on the bus, and whether the clock here
    is the cell's; exit status 1 if the stack is not up."""
    show_stack(as_json, project, run_dir, _with_signs_of_life)
