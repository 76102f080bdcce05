"""When an arm went no farther, and which ends of a service are as they must be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from crosspih_common.errors import ConfigError
from crosspih_common.messages import AssemblyPhase, Failure, Phase
from services.operator.bench.reliability.kills.judging import Limits, Observed, complaints, stopped_after_s
from services.operator.bench.reliability.kills.options import chosen
from services.operator.bench.reliability.kills.plan import (
    PHASES,
    SERVICES,
    KillCase,
    ServiceEnding,
    begins,
    cases,
    ripe,
)

LIMITS = Limits(force_cap_n=60.0, holder_timeout_s=0.1)
PERIOD_NS = 4_000_000
SIGNAL_NS = 1_000_000_000


def way(speed_rad_s: float, stops_s: float, back_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Two joints that move until `stops_s` after the signal, hold for 20 ms, and go back for `back_s`."""
    stamps = np.arange(SIGNAL_NS - 40_000_000, SIGNAL_NS + 1_000_000_000, PERIOD_NS)
    seconds = (stamps - SIGNAL_NS) * 1e-9
    gone = np.minimum(seconds, stops_s) - np.clip(seconds - stops_s - 0.02, 0.0, back_s)
    return stamps, np.outer(gone * speed_rad_s, [0.6, -0.8])


@given(some.floats(0.02, 1.0), some.floats(0.01, 0.6), some.floats(0.0, 0.3))
def test_an_arm_stops_where_it_goes_no_farther_also_when_it_goes_back(speed: float, stops: float, back: float) -> None:
    found = stopped_after_s(*way(speed, stops, back), SIGNAL_NS)
    assert found is not None
    # a sample late at most, and early by what of the way does not count
    assert stops - 2e-5 / speed - 1e-9 <= found <= stops + 1.01 * PERIOD_NS * 1e-9


def test_an_arm_that_stands_does_not_stop() -> None:
    stamps, joints = way(0.5, -1.0, 0.0)
    assert stopped_after_s(stamps, np.zeros_like(joints), SIGNAL_NS) is None
    assert stopped_after_s(stamps[:1], joints[:1], SIGNAL_NS) is None


def test_all_cases_are_planned_once() -> None:
    planned = list(cases(SERVICES, PHASES, ServiceEnding, 7))
    assert len(planned) == len(set(planned)) == len(SERVICES) * len(PHASES) * len(ServiceEnding)


def test_the_moment_is_waited_for() -> None:
    case = KillCase(service="vision", phase=Phase.PUSHING, ending=ServiceEnding.KILL, seed=1)
    assert begins(case, AssemblyPhase(assembly_id="", phase=Phase.PUSHING, text="compliant push 2"))
    assert not begins(case, AssemblyPhase(assembly_id="", phase=Phase.PUSHING, text="did not enter"))
    assert ripe(case, 0.0, 6.0) and not ripe(case, 1.0, 1.0)


def case_of(service: str, ending: ServiceEnding = ServiceEnding.KILL) -> KillCase:
    return KillCase(service=service, phase=Phase.PUSHING, ending=ending, seed=1)


def seen(**changes: object) -> Observed:
    """An orderly end after a lost service, but for what is changed."""
    orderly = {
        "signalled": True, "moving": True, "named_s": 0.2, "named_by": "its token", "failure": Failure.SERVICE_LOST,
        "backed_off": True, "done_reported": True, "ended_s": 5.0, "peak_n": 20.0, "tip_before_m": 0.06,
    }  # fmt: skip
    return Observed.model_validate({**orderly, **changes})


INSERTED = {"inserted": True, "failure": None, "backed_off": False, "tip_before_m": -0.03}


@pytest.mark.parametrize(
    ("service", "changes"),
    [
        ("vision", {}),
        ("inference", INSERTED),
        ("recorder", INSERTED),
        ("hardware", {"tip_before_m": None, "backed_off": False}),
        ("planning", {"failure": None, "asker_told": "nobody answers", "stop_s": 0.12, "tip_before_m": -0.02}),
        ("planning", {"failure": None, "asker_told": "nobody answers", "stop_s": 0.36, "beats_s": 0.08}),
    ],
)
def test_what_is_in_order(service: str, changes: dict[str, object]) -> None:
    assert complaints(case_of(service), seen(**changes), LIMITS) == []


@pytest.mark.parametrize(
    ("service", "changes", "said"),
    [
        ("vision", {"signalled": False}, "never came"),
        ("vision", {"peak_n": 67.0}, "pressed with 67 N"),
        ("vision", {"named_s": 1.5}, "named after 1.50 s"),
        ("vision", {"named_s": None}, "nobody named"),
        ("vision", {"named_s": None, "ended_s": None}, "nobody named"),
        ("vision", {"ended_s": None}, "did not end"),
        ("vision", {"failure": Failure.NOT_CONVERGED}, "ended as not_converged, want service_lost"),
        ("vision", {"backed_off": False}, "not backed off"),
        ("vision", {"tip_before_m": -0.01}, "still 10 mm in the hole"),
        ("vision", {"done_reported": False}, "no DONE"),
        ("recorder", {}, "did not go on"),
        ("hardware", INSERTED, "without hardware"),
        ("planning", {"failure": None}, "was not told"),
        (
            "planning",
            {"asker_told": "nobody answers", "stop_s": 0.31},
            "0.31 s without a beat of its holder, want 0.3 s",
        ),
        ("planning", {"asker_told": "nobody answers", "stop_s": 0.45, "beats_s": 0.1}, "went on for 0.35 s"),
    ],
)
def test_what_is_not(service: str, changes: dict[str, object], said: str) -> None:
    found = complaints(case_of(service), seen(**changes), LIMITS)
    assert any(said in complaint for complaint in found), found


def test_a_planner_that_hung_must_deal_with_an_arm_that_let_go() -> None:
    case = case_of("planning", ServiceEnding.STOP)
    assert complaints(case, seen(failure=Failure.ARM_STOPPED), LIMITS) == []
    assert complaints(case, seen(**INSERTED), LIMITS) == []
    assert complaints(case, seen(failure=Failure.DEFECT), LIMITS) != []
    late = seen(failure=Failure.ARM_STOPPED, named_s=3.5, stop_reason="holder_lost")
    assert complaints(case, late, LIMITS) == ["named after 3.50 s, want 1 s"]


@pytest.mark.parametrize("service", SERVICES)
@pytest.mark.parametrize("ending", list(ServiceEnding))
def test_every_loss_is_to_be_named_within_a_second(service: str, ending: ServiceEnding) -> None:
    for named_s in (1.01, 5.0, None):
        found = complaints(case_of(service, ending), seen(**{**INSERTED, "named_s": named_s}), LIMITS)
        assert any("named" in complaint for complaint in found), found


def test_what_is_asked_for_is_chosen_in_the_order_of_the_plan() -> None:
    assert chosen("--phase", ["seated", "locating"], PHASES) == (Phase.LOCATING, Phase.SEATED)
    assert chosen("--service", None, SERVICES) == SERVICES
    assert chosen("--signal", [ServiceEnding.STOP], ServiceEnding) == (ServiceEnding.STOP,)
    with pytest.raises(ConfigError, match=r"^--phase approach, zero: want one of locating, approaching, pushing"):
        chosen("--phase", ["zero", "seated", "approach"], PHASES)
