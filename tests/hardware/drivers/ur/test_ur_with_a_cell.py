"""The simulated cell behind the controller: pressed on through RTDE, servoj's delay and all, the cap holds."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest
import yaml

from crosspih_common.geometry import Pose
from crosspih_common.messages.base import PoseData
from services.hardware.peers.ur.exercise import BEFORE_M, BESIDE_M, CELL, CLEAR_M, Exercised, guarded
from tests.hardware.drivers.ur.ur_peer import address


def test_a_guarded_move_through_the_controller_stays_below_the_cap(tmp_path: Path) -> None:
    content = yaml.safe_load(CELL.read_text(encoding="utf-8"))
    # a test machine has other things to do
    content["hardware"]["limits"] |= {"missed_cycles": 10000, "holder_timeout_s": 5.0}
    content["hardware"]["ur"]["silence_s"] = 1.0
    content["hardware"]["simulated"] = {"seed": 7}
    file = tmp_path / "cell.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    it = Exercised(argparse.Namespace(cell=file, address=address()), behind=True)
    try:
        it.know_payload()
        truth = it.peer.tell("truth")
        assert truth["seed"] == 7
        hole = PoseData.model_validate(truth["pose_base_hole"]).pose()
        before = hole @ Pose.from_translation([*BESIDE_M, -it.workcell.peg.shape().tip_m - BEFORE_M])
        it.line_to(before @ Pose.from_translation([0.0, 0.0, -CLEAR_M]), 0.25)
        it.line_to(before, 0.25)
        outcome = guarded(it, 0.02, 0.25)
        assert outcome.stop_reason.value == "contact"
        assert any("speed_m_s slowed" in note for note in outcome.notes)  # by servoj's delay
        # where the plate is, by the encoders: what servoj lags behind must not be taken for travel
        felt = outcome.pose_base_peg_first_contact
        assert felt is not None
        tip = hole.inverse().apply(felt.pose().apply([0.0, 0.0, it.workcell.peg.shape().tip_m]))
        assert tip[2] == pytest.approx(0.0, abs=5e-4)
        pressed_n = it.peer.tell("truth")["peak_contact_n"]
        assert 3.0 < pressed_n < 1.1 * it.hosted.arm._config.force_cap_n
        assert pressed_n == pytest.approx(outcome.peak_force_n, abs=3.0)
    finally:
        it.close()
