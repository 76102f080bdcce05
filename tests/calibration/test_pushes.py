"""Stiffness, mounting and tip from pushes whose answer is known; intervals that hold; refusals with what is missing."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.calibration.fitting import CalibrationRefused
from crosspih_common.calibration.mount import fit_mount
from crosspih_common.calibration.stiffness import fit_stiffness
from crosspih_common.calibration.tcp import fit_tip
from tests.calibration.synthetic_presses import WORKCELL, Machine, Rig

SEEDS = 10
DRAWN = np.asarray(WORKCELL.joint_stiffness_nm_rad)


def test_stiffness_is_found_within_5_percent_and_a_joint_that_no_push_turns_is_named() -> None:
    inside, off = [], []
    for seed in range(SEEDS):
        factors = np.exp(np.random.default_rng(seed).normal(size=6) * 0.15)
        fit = fit_stiffness(Rig(Machine(factors=factors), seed).pressed(), WORKCELL)
        share = fit.stiffness_nm_rad / (DRAWN * factors) - 1.0
        fixed = np.array(fit.taken)
        off += np.abs(share[fixed]).tolist()
        inside += (np.abs(share) <= fit.half_share)[fixed].tolist()
        # its axis is that of the peg: pushes on the face have no lever about it
        assert not fit.taken[5] and "joint 6 stays as it was" in " ".join(fit.missing)
        assert fit.held_out_m < 3.0 * fit.rms_m < 1e-6
    assert len(off) >= 4 * SEEDS and max(off) < 0.06 and np.median(off) < 0.02
    assert np.mean(inside) >= 0.9


def test_the_sensors_turn_and_place_are_found_with_intervals_that_hold() -> None:
    inside = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        machine = Machine(turn_rad=rng.normal(size=3) * 0.01, sensor_m=rng.normal(size=3) * 5e-4)
        fit = fit_mount(Rig(machine, seed).pressed(), WORKCELL)
        turn, place = fit.turn_rad - machine.turn_rad, fit.shift_m - machine.sensor_m
        assert np.abs(turn).max() < np.deg2rad(0.1) and np.abs(place).max() < 1.5e-4
        inside += (np.abs(turn) <= fit.turn_half_rad).tolist() + (np.abs(place) <= fit.shift_half_m).tolist()
        assert fit.weight_n == pytest.approx(9.555, abs=0.05)
    assert np.mean(inside) >= 0.9


def test_the_tip_is_found_with_intervals_that_hold() -> None:
    inside = []
    for seed in range(SEEDS):
        shift = np.random.default_rng(seed).normal(size=3) * 5e-4
        fit = fit_tip(Rig(Machine(peg_m=shift), seed).pressed(), WORKCELL)
        assert np.abs(fit.shift_m - shift).max() < 2e-5
        inside += (np.abs(fit.shift_m - shift) <= fit.half_m).tolist()
        tip = WORKCELL.pose_flange_peg().apply([0.0, 0.0, WORKCELL.peg.shape().tip_m])
        assert fit.tip_flange_m == pytest.approx(tip + shift, abs=2e-5)
    assert np.mean(inside) >= 0.9


def test_edges_that_are_not_quite_sharp_do_not_break_the_tips_interval() -> None:
    for seed in range(3):
        fit = fit_tip(Rig(Machine(edge_m=5e-6), seed).pressed(), WORKCELL)
        sharp = fit_tip(Rig(Machine(), seed).pressed(), WORKCELL)
        assert np.abs(fit.shift_m[2] - sharp.shift_m[2]) > 8e-6
        assert np.all(np.abs(fit.shift_m) <= fit.half_m) and fit.half_m[2] < 1e-4


def test_one_take_tells_all_three_one_after_the_other() -> None:
    machine = Machine(
        factors=np.array([1.2, 0.9, 1.1, 0.85, 1.15, 1.0]), turn_rad=np.array([0.01, -0.005, 0.008]),
        sensor_m=np.array([4e-4, -3e-4, 2e-4]), peg_m=np.array([-3e-4, 2e-4, 3e-4]),
    )  # fmt: skip
    pressed = Rig(machine, 3).pressed()
    tip = fit_tip(pressed, WORKCELL)
    moved = WORKCELL.model_copy(
        update={
            "flange_to_ft": WORKCELL.flange_to_ft.model_copy(
                update={"position_m": tuple((WORKCELL.pose_flange_peg().translation_m + tip.shift_m).tolist())}
            ),
            "force_torque": WORKCELL.force_torque.model_copy(update={"pose_flange_sensor": WORKCELL.flange_to_ft}),
        }
    )
    mount = fit_mount(pressed, moved)
    assert mount.pose_peg_sensor.translation_m == pytest.approx(machine.sensor_m - tip.shift_m, abs=1.5e-4)


@pytest.mark.parametrize(
    ("take", "fit", "said"),
    [
        ({"count": 3}, fit_stiffness, "3 pushes, want 4"),
        ({"forces": (4.0,)}, fit_stiffness, "hold each at two or more"),
        ({"forces": (4.0, 4.5)}, fit_stiffness, "push harder"),
        ({"weighings": 1, "wrist": 0.0, "tilts": (0.02, 0.03)}, fit_mount, "turn the wrist further"),
        ({"tilts": (0.03, 0.04)}, fit_mount, "tilt the peg"),
        ({"tilts": (0.3,)}, fit_tip, "all tilts are of the same size"),
        ({"corners": 1}, fit_tip, "tilted to one side only"),
    ],
)
def test_data_that_fix_nothing_are_refused_with_what_is_missing(
    take: dict[str, object], fit: object, said: str
) -> None:
    assert callable(fit)
    pressed = Rig(Machine(), 1).pressed(**take)  # type: ignore[arg-type]
    with pytest.raises(CalibrationRefused, match=said):
        fit(pressed, WORKCELL)
