"""Recordings as tables and as a figure: known answers from a recording made by hand."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.client import Recording
from crosspih_common.errors import ConfigError
from crosspih_common.keys import CLOCK, CONTACT_WRENCH, JOINT_STATE, WRENCH_RAW
from crosspih_common.messages import CellClock, JointState, Phase, RawWrenchBatch
from tests.recorder.synthetic import START_NS, SyntheticRecording, at, write_assembly

MS = 1_000_000


@pytest.fixture(scope="module")
def assembly(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("recorded") / "a.mcap"
    write_assembly(path)
    return Recording(path)


@pytest.fixture
def streams(tmp_path: Path) -> Iterator[Recording]:
    made = SyntheticRecording(tmp_path / "s.mcap")
    made.add(CLOCK, CellClock(stamp_ns=START_NS, boot_id="b", realtime=True))
    for batch in range(2):
        samples = tuple(tuple(float(100 * batch + 10 * row + column) for column in range(6)) for row in range(3))
        made.add(WRENCH_RAW, RawWrenchBatch(stamp_ns=START_NS + batch * 3 * MS, period_ns=MS, samples=samples))
    joints = JointState(stamp_ns=START_NS + MS, joints_rad=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6), speeds_rad_s=(1.0,) * 6)
    made.add(JOINT_STATE, joints)
    made.finish()
    yield Recording(tmp_path / "s.mcap")


def test_a_wrench_has_units_in_its_columns_and_cell_time_from_the_beginning(assembly: Recording) -> None:
    table = assembly.to_pandas("force_torque/wrench")
    messages = assembly.messages(CONTACT_WRENCH)
    assert list(table.columns[:9]) == [
        "t_s", "stamp_ns", "seq", "frame", "force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm",
    ]  # fmt: skip
    wrench = table[[f"force_{axis}_n" for axis in "xyz"] + [f"moment_{axis}_nm" for axis in "xyz"]].to_numpy()
    np.testing.assert_array_equal(wrench, [message.wrench for message in messages])
    assert table["t_s"].iloc[-1] - table["t_s"].iloc[0] == pytest.approx(12.39)
    assert table["seq"].tolist() == list(range(1240)) and "memory" in table
    assert table.equals(assembly.to_pandas(CONTACT_WRENCH))


def test_each_sample_of_a_batch_is_a_row_at_its_own_time(streams: Recording) -> None:
    table = streams.to_pandas("ft/raw")
    assert ((table["stamp_ns"] - START_NS) // MS).tolist() == [0, 1, 2, 3, 4, 5]
    assert table["t_s"].tolist() == pytest.approx([0.0, 0.001, 0.002, 0.003, 0.004, 0.005])
    assert table["channel_1"].tolist() == [0.0, 10.0, 20.0, 100.0, 110.0, 120.0]
    assert table["channel_6"].tolist() == [5.0, 15.0, 25.0, 105.0, 115.0, 125.0]


def test_joints_poses_and_services_have_columns_of_their_own(assembly: Recording, streams: Recording) -> None:
    joints = streams.to_pandas("arm/joint_state").iloc[0]
    assert joints["joint_1_rad"] == 0.1 and joints["joint_6_rad"] == 0.6 and joints["speed_3_rad_s"] == 1.0
    touches = assembly.to_pandas("planning/touch")
    for name in ("pose_base_peg_x_m", "pose_base_peg_quaternion_w", "direction_base_z", "wrench_sd_force_x_n"):
        assert name in touches
    assert touches["force_z_n"].tolist() == [-14.0, -14.0] and touches["state_case"].tolist() == ["1-2-2", "1-2-2"]
    assert assembly.to_pandas("service/*/status")["service"].tolist() == ["hardware", "planning"]
    assert assembly.to_pandas("service/planning/status")["service"].tolist() == ["planning"]
    picture = assembly.to_pandas("vision/annotated/left").iloc[0]
    assert picture["pixels"].shape == (480, 640, 3)
    assert len(assembly.to_pandas("inference/estimate/reply")["covariance"].iloc[0]) == 36


def test_what_a_recording_holds_and_how_it_ended(assembly: Recording) -> None:
    assert "planning/phase" in assembly.topics() and "service/vision/event" in assembly.topics()
    result = assembly.result()
    assert result is not None and result.inserted
    with pytest.raises(ConfigError, match=r"ft/raw: not in .*a\.mcap; it has .*force_torque/wrench"):
        assembly.to_pandas("ft/raw")
    with pytest.raises(ConfigError, match="did you mean force_torque/wrench"):
        assembly.to_pandas("force_torque/wrenches")


def test_the_figure_has_the_forces_the_phases_and_the_touches(assembly: Recording, streams: Recording) -> None:
    figure = assembly.plot()
    force, moment = figure.axes
    assert [axes.get_ylabel() for axes in (force, moment)] == ["contact force / N", "contact moment / Nm"]
    assert force.get_lines()[2].get_ydata().tolist() == [one.wrench[2] for one in assembly.messages(CONTACT_WRENCH)]  # type: ignore[union-attr]
    assert moment.get_xlim()[1] == pytest.approx((at(12.4) - at(0.0)) * 1e-9)
    assert [text.get_text() for text in force.texts] == ["1", "2"]
    legend = moment.get_legend()
    assert legend is not None
    named = [text.get_text() for text in legend.get_texts()]
    assert Phase.PUSHING.value in named and Phase.TOUCHING.value in named
    figure.canvas.draw()
    with pytest.raises(ConfigError, match="nothing to draw"):
        streams.plot()


def test_a_package_that_is_missing_is_named(assembly: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ConfigError, match=r"pandas is not installed.*pip install 'crosspih\[client\]'"):
        assembly.to_pandas("force_torque/wrench")
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ConfigError, match="matplotlib is not installed"):
        assembly.plot()
