"""The panel below an assembly's story: how it stands, and that a pipe sees the lines alone."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from crosspih_common.messages import (
    AssemblyPhase,
    ContactWrench,
    Event,
    Phase,
    PoseData,
    PoseErrorEstimate,
    Severity,
)
from services.operator.assembly.display.drawing import drawn, narrowed, sparkline
from services.operator.assembly.display.live import LiveStory, caps_of
from services.operator.assembly.display.standing import AssemblyStanding, Caps
from services.operator.cli.time_left import TimeLeft, in_words

START_NS = 5_000_000_000


def _stamp(at_s: float) -> int:
    return START_NS + round(at_s * 1e9)


def _phase(phase: Phase, at_s: float, **figures: float) -> AssemblyPhase:
    return AssemblyPhase(assembly_id="a", phase=phase, text=phase.value, figures=figures, stamp_ns=_stamp(at_s))


def _felt(force_n: float, at_s: float) -> ContactWrench:
    return ContactWrench(
        wrench=(0.0, 0.0, -force_n, force_n / 20.0, 0.0, 0.0), in_contact=True, free_residual_n=0.0,
        drift_suspected=False, stamp_ns=_stamp(at_s),
    )  # fmt: skip


@pytest.fixture
def standing() -> AssemblyStanding:
    """Located, driven there, pushing for 3 s with 30 N at most."""
    found = AssemblyStanding("seed 7, peg cross, fused", Caps(60.0, 6.0))
    found.begin(START_NS)
    found.add_phase(_phase(Phase.LOCATING, -1.0))  # of another assembly
    found.add_phase(_phase(Phase.LOCATING, 0.5, sd_lateral_mm=0.268, sd_depth_mm=0.254, sd_tilt_deg=0.795))
    found.add_phase(_phase(Phase.APPROACHING, 0.75))
    found.add_phase(_phase(Phase.PUSHING, 4.75))
    for index in range(300):
        found.add_wrench(_felt(30.0 * (index % 100) / 99, 4.75 + index * 0.01))
    return found


def test_phases_have_the_cells_time_and_the_running_one_grows(standing: AssemblyStanding) -> None:
    assert standing.in_phase_s(Phase.LOCATING) == pytest.approx(0.25)
    assert standing.in_phase_s(Phase.APPROACHING) == pytest.approx(4.0)
    assert standing.in_phase_s(Phase.PUSHING) == pytest.approx(2.99)
    assert standing.in_phase_s(Phase.SEATED) is None and standing.pushes == 1


def test_the_history_has_the_largest_of_each_piece_and_forgets(standing: AssemblyStanding) -> None:
    assert max(standing.history()) == pytest.approx(30.0) and max(standing.history(moments=True)) == pytest.approx(1.5)
    before = len(standing.history())
    standing.add_wrench(_felt(1.0, 60.0))
    assert len(standing.history()) == before and max(standing.history()) == 1.0 and standing.peak_n == 30.0


def test_an_estimate_replaces_what_vision_said(standing: AssemblyStanding) -> None:
    assert standing.believed is not None and standing.believed.by == "vision"
    variances = (4e-6, 0.0, 1e-6, 0.0, 1e-4, 0.0)
    covariance = tuple(variances[row] if row == column else 0.0 for row in range(6) for column in range(6))
    pose = PoseData(position_m=(0.4, -0.3, 0.2), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    estimate = PoseErrorEstimate(
        pose_base_hole=pose, covariance=covariance, angles_rad=(0.0,) * 3, translation_m=(0.0,) * 3, rank=5,
        residual_cost=0.0, friction=0.1, friction_sd=0.1, method="fused", rests_on=(), compute_s=0.1,
        stamp_ns=_stamp(8.0),
    )  # fmt: skip
    standing.add_estimate(estimate)
    found = standing.believed
    assert found.by == "fused"
    assert found.sd_lateral_mm == pytest.approx(2.0) and found.sd_depth_mm == pytest.approx(1.0)
    assert found.sd_tilt_deg == pytest.approx(0.573, abs=1e-3)


def test_what_is_felt_before_a_calibration_has_ended_counts_for_nothing() -> None:
    standing = AssemblyStanding("", Caps(60.0, 6.0))
    standing.begin(START_NS)
    standing.add_phase(_phase(Phase.CALIBRATING, 1.0))
    standing.add_wrench(_felt(40.0, 2.0))
    assert not standing.felt and standing.peak_n == 0.0


@pytest.mark.parametrize("width", [80, 110, 200])
def test_the_panel_fits_and_stays_as_high_as_it_was(standing: AssemblyStanding, width: int) -> None:
    def lines() -> list[str]:
        out = io.StringIO()
        Console(file=out, width=width, force_terminal=False).print(drawn(standing, width))
        return out.getvalue().splitlines()

    before = lines()
    assert all(len(line) <= width for line in before)
    assert any("pushing 3.0 s" in line for line in before) and any("cap 60" in line for line in before)
    standing.add_phase(_phase(Phase.TOUCHING, 8.0))
    assert len(lines()) == len(before)


def test_a_warning_stands_in_the_panel_and_in_the_lines(standing: AssemblyStanding) -> None:
    out = io.StringIO()
    console = Console(file=out, width=110)
    story = LiveStory(console, standing)
    story.begin(START_NS)
    story.event(Event(service="vision", severity=Severity.WARNING, code="service_lost", text="vision is gone"))
    assert "vision: service_lost: vision is gone" in out.getvalue()
    console.print(story)
    assert out.getvalue().count("vision is gone") == 2


def test_small_drawings() -> None:
    assert sparkline([0.0, 5.0, 10.0, 20.0], 10.0) == " ▄██"
    assert narrowed([1.0, 3.0, 2.0, 0.0, 9.0], 3) == [3.0, 2.0, 9.0]


def test_caps_are_the_cells() -> None:
    assert caps_of({"hardware": {"limits": {"force_cap_n": 25}}}) == Caps(25.0, 6.0)
    assert caps_of({}) == Caps(60.0, 6.0)


def test_the_time_left_goes_by_what_the_parts_took() -> None:
    now = [100.0]
    left = TimeLeft(5, lambda: now[0])
    assert left.after(0) == "" and left.after(5) == ""
    now[0] = 140.0
    assert left.after(2) == ", about 60 s left"
    assert [in_words(value) for value in (89.0, 90.0, 7200.0)] == ["89 s", "2 min", "2.0 h"]
