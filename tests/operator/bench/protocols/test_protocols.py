"""The bench of protocols: its processes are started, asked and ended, and its counts are right."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from crosspih_common.errors import NoService
from crosspih_common.messages import JointState
from services.operator.bench.protocols.assembling import CycleCount, ProtocolResult, ProtocolTrial, line_of, table_of
from services.operator.bench.protocols.peers import Peer
from services.operator.bench.protocols.plants import ProtocolWay, base_content


def test_a_peer_answers_lines_and_is_ended(tmp_path: Path) -> None:
    words = ["services.hardware.peers.ur", "--address", "127.0.0.41"]
    with Peer("ur", words, os.environ, tmp_path) as peer:
        peer.line("ready")
        assert json.loads(peer.ask("state"))["cycles"] >= 0
        assert peer.ask("no-such-thing").strip('"').startswith("no such thing")
    with pytest.raises(NoService, match="ur"):
        peer.line()


def test_a_peer_that_does_not_come_up_says_why(tmp_path: Path) -> None:
    with (
        Peer("ur", ["services.hardware.peers.ur", "--no-such-option"], os.environ, tmp_path) as peer,
        pytest.raises(NoService, match="no-such-option"),
    ):
        peer.line("ready")


def test_late_states_are_counted_by_their_stamps() -> None:
    count = CycleCount()
    for stamp_ms in (0, 4, 8, 12, 24, 28, 32):
        count.add_state(JointState(stamp_ns=stamp_ms * 1_000_000, joints_rad=(0.0,) * 6, speeds_rad_s=(0.0,) * 6))
    states, late, between_ms = count.counted()
    assert (states, late) == (7, 1)
    assert between_ms is not None and between_ms[0] == pytest.approx(4.0)


def test_the_table_names_each_failure() -> None:
    rows = [
        ProtocolTrial(seed=1, inserted=True, failure=None, detail="", motion_s=20.0, final_error_mm=0.01),
        ProtocolTrial(seed=2, inserted=False, failure="arm_stopped", detail="late"),
    ]
    table = table_of(ProtocolResult(way="ur", inserted=1, trials=rows))
    cells = [str(cell) for column in table.columns for cell in column.cells]
    assert "ended as arm_stopped" in cells and any("1 of 2" in cell for cell in cells)


@pytest.mark.parametrize("way", list(ProtocolWay))
def test_what_stands_behind_the_protocols_is_a_shipped_cell(way: ProtocolWay) -> None:
    assert "hole_prior" in base_content(way)["cell"] or way is ProtocolWay.ROS2


def test_each_assembly_is_told_in_a_line() -> None:
    entered = ProtocolTrial(
        seed=7, inserted=True, failure=None, detail="", motion_s=11.26, peak_force_n=6.04, wall_s=61.2, cycles=5000,
        late_cycles=2, states=4000, late_states=1,
    )  # fmt: skip
    assert line_of(entered) == (
        "seed 7: inserted, motion 11.3 s, peak 6.0 N, 2 of 5000 cycles late, 1 of 4000 joint states late, 61 s in all"
    )
    lost = ProtocolTrial(seed=8, inserted=False, failure="no_result", detail="NoService: gone", wall_s=3.0)
    assert line_of(lost) == "seed 8: no_result, 3 s in all: NoService: gone"
