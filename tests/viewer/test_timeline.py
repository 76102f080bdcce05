"""What was true at a moment, of what was said."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.messages import (
    AssemblyPhase,
    AssemblyResult,
    ContactState,
    ContactWrench,
    HoleEstimate,
    JointState,
    LocateMethod,
    Phase,
    PoseData,
    Strategy,
    Touch,
)
from services.viewer.charts import GROUP_OF, GROUPS, chart_of
from services.viewer.timeline import KEPT_NS, SLACK_NS, PhaseSpan, Timeline

POSE = PoseData(position_m=(0.4, -0.3, 0.2), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
FREE = ContactState(case=None, n_z0=0.0, confidence=0.0)
S = 10**9


def phase(at_s: float, what: Phase, trial: str = "a") -> AssemblyPhase:
    return AssemblyPhase(stamp_ns=round(at_s * S), assembly_id=trial, phase=what, text=what.value)


def touch(at_s: float, force_n: float = 5.0, seated: bool = False) -> Touch:
    return Touch(
        stamp_ns=round(at_s * S), index=0, seated=seated, pose_base_peg=POSE, direction_base=(1.0, 0.0, 0.0),
        joints_rad=(0.0,) * 6, wrench=(0.0, 0.0, -force_n, 0.0, 0.0, 0.0), wrench_sd=(0.1,) * 6, state=FREE,
    )  # fmt: skip


def hole(at_s: float) -> HoleEstimate:
    return HoleEstimate(
        stamp_ns=round(at_s * S), pose_base_hole=POSE, covariance=tuple(np.diag([1e-8] * 6).ravel()),
        method=LocateMethod.RIM, orientation_measured=True, capture_id=1, capture_wall_s=0.1,
    )  # fmt: skip


def result(at_s: float) -> AssemblyResult:
    return AssemblyResult(
        stamp_ns=round(at_s * S), assembly_id="a", strategy=Strategy.FUSED, inserted=True, failure=None,
        backed_off=False, pose_base_hole=POSE, pose_base_peg=POSE, vision_pose_base_hole=POSE, motion_s=1.0,
        thinking_s=0.0, touches=1, presses=0, corrections=0, pushes=1, peak_force_n=5.0, peak_moment_nm=0.1,
        insertion_depth_m=0.025,
    )  # fmt: skip


@pytest.fixture
def told() -> Timeline:
    """Two assemblies, and a wrench each tenth of a second."""
    timeline = Timeline(6)
    for at in range(0, 200):
        wrench = (at / 100.0, 0.0, 0.0, 0.0, 0.0, at / 1000.0)
        timeline.contact_wrench(
            ContactWrench(
                stamp_ns=at * S // 10, wrench=wrench, in_contact=at > 20, free_residual_n=0.0, drift_suspected=False
            )
        )
    timeline.joint_state(JointState(stamp_ns=1 * S, joints_rad=(0.1,) * 6, speeds_rad_s=(0.0,) * 6))
    for heard in (
        phase(1, Phase.LOCATING), phase(2, Phase.APPROACHING), phase(3, Phase.PUSHING), phase(3.5, Phase.PUSHING),
        phase(5, Phase.DONE), phase(8, Phase.LOCATING, "b"), phase(9, Phase.TOUCHING, "b"),
    ):  # fmt: skip
        timeline.phase(heard)
    timeline.hole(hole(1.5))
    timeline.touch(touch(4))
    timeline.result(result(5.1))
    timeline.touch(touch(9.5))
    return timeline


def test_a_moment_holds_what_was_said_until_then_and_of_its_own_assembly(told: Timeline) -> None:
    before, first, between, second = (told.at(round(at * S)) for at in (0.5, 4.2, 6.0, 9.6))
    assert before.phase is None and before.belief is None and before.joints_rad is None
    assert first.trial_ns == S and [one.stamp_ns for one in first.touches] == [4 * S]
    assert first.belief is not None and first.belief.by == "vision" and first.result is None
    assert first.in_contact and first.wrench is not None and first.wrench[0] == pytest.approx(0.42)
    assert between.result is not None and between.belief is not None and between.belief.by == "the seated peg"
    assert second.trial_ns == 8 * S and [one.stamp_ns for one in second.touches] == [round(9.5 * S)]
    assert second.belief is None and second.result is None  # of the assembly before


def test_phases_are_spans_and_one_said_twice_is_one(told: Timeline) -> None:
    assert told.at(4 * S).spans == (
        PhaseSpan(Phase.LOCATING, S, 2 * S), PhaseSpan(Phase.APPROACHING, 2 * S, 3 * S),
        PhaseSpan(Phase.PUSHING, 3 * S, 4 * S),
    )  # fmt: skip


def test_the_chart_shades_each_phase_and_marks_each_touch(told: Timeline) -> None:
    moment = told.at(5 * S)
    chart = chart_of(moment, *told.wrenches(moment.trial_ns, moment.stamp_ns), now_s=2.5)
    at = chart.times_s
    shade = dict(zip([name for name, _, _ in GROUPS] + ["touch", "now"], chart.shades, strict=True))
    assert chart.shades.shape == (len(GROUPS) + 2, len(at)) and chart.forces_n.shape == (3, len(at))
    for name, low, high in (("look", 0.0, 1.0), ("approach", 1.0, 2.0), ("push", 2.0, 4.0)):
        inside = (at > low + 1e-3) & (at < high - 1e-3)
        assert np.all(shade[name][inside] == 1.0) and np.all(shade[name][(at < low - 1e-3) | (at > high + 1e-3)] == 0.0)
    assert at[shade["touch"] > 0.0].min() == pytest.approx(3.0) and at[shade["now"] > 0.0].min() == pytest.approx(2.5)
    assert np.interp(2.0, at, chart.forces_n[0]) == pytest.approx(0.3, abs=0.011)
    assert set(GROUP_OF) == set(Phase) - {Phase.IDLE, Phase.DONE}


def test_presses_of_a_seated_peg_are_no_touches_in_the_chart(told: Timeline) -> None:
    told.touch(touch(4.5, seated=True))
    moment = told.at(5 * S)
    chart = chart_of(moment, *told.wrenches(moment.trial_ns, moment.stamp_ns))
    assert chart.times_s[chart.shades[-2] > 0.0].max() < 3.2


def test_what_is_overtaken_takes_its_place_and_of_what_is_old_the_newest_stays(
    told: Timeline,
) -> None:
    told.touch(touch(3.9))
    assert [one.stamp_ns for one in told.at(5 * S).touches] == [round(3.9 * S), 4 * S]
    told.tick(KEPT_NS + 3 * SLACK_NS)
    told.forget()
    assert len(told.wrench) == 0 and told.trials_ns() == (8 * S,)
    late = told.at(told.last_ns)
    assert late.phase is not None and late.phase.phase is Phase.TOUCHING


def test_a_cell_that_was_started_again_begins_anew(told: Timeline) -> None:
    told.clear()
    empty = told.at(told.last_ns)
    assert empty.phase is None and not empty.touches and len(told.wrench) == 0
