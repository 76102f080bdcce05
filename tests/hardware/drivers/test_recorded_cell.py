"""A recording of the simulated cell, played back through the real controller and shells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from crosspih_common.bus.codec import decode
from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.keys import (
    CAMERA_CALIBRATION,
    CAPTURE,
    DWELL,
    IMAGE_LEFT,
    JOINT_STATE,
    MOVE_LINEAR,
    WRENCH_RAW,
    Topic,
)
from crosspih_common.messages import (
    CaptureStereo,
    Dwell,
    Image,
    JointState,
    MoveLinear,
    PoseData,
    RawWrenchBatch,
    StopReason,
)
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import open_devices
from services.hardware.protocols import Devices
from tests.hardware.drivers.recorded_cell import (
    CELL,
    DEADLINE_S,
    Played,
    record_simulated,
    recorded,
    rewritten,
    running,
    samples_of,
    session,
)

ARM = frozenset({"arm", "force_torque"})
ALL = ARM | {"camera"}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Played:
    return record_simulated(tmp_path_factory.mktemp("original"))


def opened(folder: Path, file: Path, wanted: frozenset[str] = ALL, **cell: Any) -> Devices:
    path = folder / "another.yaml"
    path.write_text(yaml.safe_dump({"cell": {**CELL, **cell}, "hardware": recorded(file)}))
    loaded = load_cell(path)
    return open_devices(loaded.workcell, loaded.section("hardware", HardwareConfig), wanted, realtime=False)


def test_the_same_motions_give_the_same_streams_and_the_same_outcomes(
    original: Played, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The controller feels the recorded samples again, so it does again what it did, to the last bit."""
    assert original.outcomes[-1].stop_reason is StopReason.CONTACT
    with running(tmp_path, recorded(original.recording.path, period_s=0.001)) as (bus, lease):
        again = session(bus, lease, "again")
    assert "in between interpolated every 1 ms; every sample of the sensor, at 1000 Hz" in capfd.readouterr().err
    then, now = original.recording, again.recording
    streams: tuple[Topic[Any], ...] = (JOINT_STATE, WRENCH_RAW)
    for topic in streams:
        there = [message.model_copy(update={"seq": 0}) for message in then.messages(topic)]
        here = [message.model_copy(update={"seq": 0}) for message in now.messages(topic)]
        assert len(there) > 100 and here == there, topic.path
    assert [message.model_dump(exclude={"seq", "stamp_ns"}) for message in now.messages(CAMERA_CALIBRATION)] == [
        message.model_dump(exclude={"seq", "stamp_ns"}) for message in then.messages(CAMERA_CALIBRATION)
    ]
    (left,), (left_then,) = now.messages(IMAGE_LEFT), then.messages(IMAGE_LEFT)
    assert left.stamp_ns == left_then.stamp_ns and np.array_equal(left.pixels, left_then.pixels)
    assert again.pair.exposure_s == original.pair.exposure_s
    # what is not the encoders' own: they are interpolated where a motion ends between two states
    apart = {"seq", "joints_rad", "joints_observed_rad", "pose_base_peg", "travel_m"}
    for outcome, outcome_then in zip(again.outcomes, original.outcomes, strict=True):
        assert outcome.model_dump(exclude=apart) == outcome_then.model_dump(exclude=apart)
        np.testing.assert_allclose(outcome.joints_rad, outcome_then.joints_rad, atol=1e-5)


def test_without_a_period_every_recorded_state_is_read_and_nothing_in_between(
    original: Played, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The arm is told nothing: it is watched, through a dwell that lasts as long as the recording."""
    first_ns, last_ns = original.outcomes[0].start_stamp_ns, original.outcomes[-1].stamp_ns
    with running(tmp_path, recorded(original.recording.path)) as (bus, lease):
        states: list[JointState] = []
        batches: list[RawWrenchBatch] = []
        bus.subscribe_inline(JOINT_STATE, states.append)
        bus.subscribe_inline(WRENCH_RAW, batches.append)
        lease.ask(DWELL, Dwell(duration_s=(last_ns - first_ns) * 1e-9 - 0.05), DEADLINE_S)
    assert "interpolated" not in capfd.readouterr().err
    there = {state.stamp_ns: state.joints_rad for state in original.recording.messages(JOINT_STATE)}
    played = [state for state in states if state.stamp_ns in there]
    assert len(played) >= len(there) - 30 and len(played) >= len(states) - 1
    assert all(there[state.stamp_ns] == state.joints_rad for state in played)
    (stamps, samples), (stamps_then, samples_then) = (
        samples_of(heard) for heard in (batches, original.recording.messages(WRENCH_RAW))
    )
    assert len(stamps) > 1000
    assert np.array_equal(stamps, stamps_then[: len(stamps)]) and np.array_equal(samples, samples_then[: len(stamps)])


def test_an_arm_that_is_told_to_go_elsewhere_is_halted(original: Played, tmp_path: Path) -> None:
    with running(tmp_path, recorded(original.recording.path, period_s=0.001)) as (bus, lease):
        at = lease.ask(DWELL, Dwell(duration_s=0.05), DEADLINE_S).pose_base_peg.pose()
        aside = MoveLinear(pose_base_peg=PoseData.of(Pose(at.rotation, at.translation_m + np.array([0.0, 0.01, 0.0]))))
        for _ in range(2):
            with pytest.raises(CommandRefused, match=r"cannot be steered: at 0\.\d+ s joint \d was at .* is told"):
                lease.ask(MOVE_LINEAR, aside, DEADLINE_S)
        before_ns = bus.clock.now_ns()
        rest = lease.ask(DWELL, Dwell(duration_s=0.2), DEADLINE_S)
        # time goes on, and no sample is made up
        assert rest.stamp_ns > before_ns and rest.stop_reason is StopReason.SENSOR_LOST


def test_pictures_are_given_once_and_in_the_light_in_which_they_were_taken(original: Played, tmp_path: Path) -> None:
    hardware = {**recorded(original.recording.path), "devices": ["camera"]}
    with pytest.raises(Exception, match="arm/lease/take"), running(tmp_path, hardware):
        pass
    devices = opened(tmp_path, original.recording.path, frozenset({"camera"}))
    camera = devices.camera
    assert camera is not None
    for scale, lamp, words in ((1.0, 0, "exposure_scale: 1 is asked for"), (2.0, 1, "lamp: 1 is asked for")):
        with pytest.raises(CommandRefused, match=words):
            camera.capture(scale, lamp)
    taken = camera.capture(2.0, 0)
    sample = original.recording.samples[IMAGE_LEFT.key(CELL["name"])][0]
    there = decode(Image, sample.payload, sample.label, sample.key)
    assert taken.stamp_ns == there.stamp_ns and np.array_equal(taken.left, there.pixels)
    with pytest.raises(CommandRefused, match="no picture is left: the last of 1 pairs"):
        camera.capture(2.0, 0)


@pytest.mark.parametrize("topic", [JOINT_STATE, WRENCH_RAW, IMAGE_LEFT, CAPTURE.reply_echo])
def test_a_missing_channel_is_named(original: Played, tmp_path: Path, topic: Topic[Any]) -> None:
    path = topic.path
    file = rewritten(original.recording.path, tmp_path / "less.mcap", leave_out=path)
    with pytest.raises(ConfigError, match=f"hardware.recorded.file: .*less.mcap holds no {path}"):
        opened(tmp_path, file)


def test_a_torn_file_is_refused_unless_it_is_wanted(original: Played, tmp_path: Path) -> None:
    whole = original.recording.path.read_bytes()
    file = tmp_path / "torn.mcap"
    file.write_bytes(whole[: len(whole) * 3 // 4])
    with pytest.raises(ConfigError, match=r"was torn off after \d\.\d+ s .*hardware.recorded.torn: true"):
        opened(tmp_path, file)
    config = HardwareConfig.model_validate({**recorded(file), "recorded": {"file": str(file), "torn": True}})
    workcell = load_cell(tmp_path / "another.yaml").workcell
    devices = open_devices(workcell, config, ARM, realtime=False)
    assert devices.joints is not None and devices.joints.read().stamp_ns == original.outcomes[0].start_stamp_ns
    file.write_bytes(b"no recording")
    with pytest.raises(ConfigError, match="is no MCAP file"):
        opened(tmp_path, file)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arm": {"name": "ur5e"}}, r"^cell.arm.name: .* was recorded with xb4, the cell's file says ur5e"),
        ({"peg": {"outline": "star"}}, r"^cell.peg.outline: .* with cross, the cell's file says star"),
        ({"flange_to_ft": {"position_m": [0.0, 0.0, 0.07]}}, r"^cell.flange_to_ft.pose: "),
        ({"camera": {**CELL["camera"], "fx_px": 400.0}}, r"^cell.camera.fx_px: .* with 381.36, .* 400"),
    ],
)
def test_another_cell_is_refused_by_the_field(
    original: Played, tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        opened(tmp_path, original.recording.path, **change)


def test_a_recording_that_does_not_say_its_cell_is_held_to_what_was_measured(original: Played, tmp_path: Path) -> None:
    file = rewritten(original.recording.path, tmp_path / "bare.mcap", metadata={"cell": {}})
    opened(tmp_path, file)
    with pytest.raises(ConfigError, match=r"cell.arm: panda has 7 joints, .*bare.mcap has 6"):
        opened(tmp_path, file, arm={"name": "panda"})
    with pytest.raises(ConfigError, match=r"cell.camera.width_px: .* was recorded with 160"):
        opened(tmp_path, file, camera={})


def test_settings_that_cannot_be_are_named(original: Played, tmp_path: Path) -> None:
    opened(tmp_path, original.recording.path)
    workcell = load_cell(tmp_path / "another.yaml").workcell
    for options, words in (
        ({"period_s": 0.003}, "period_s: 0.003 s does not divide"),
        ({"period_s": 0.008}, "period_s: 0.008 s does not divide"),
        ({"from_s": 500.0}, "from_s: 500 s is after the end"),
        ({"file": None}, "names no recording"),
    ):
        section = {"file": str(original.recording.path), **options}
        config = HardwareConfig.model_validate({"driver": "recorded", "recorded": section})
        with pytest.raises(ConfigError, match=words):
            open_devices(workcell, config, ARM, realtime=False)


def test_in_real_time_it_plays_by_itself_and_a_capture_waits_for_its_picture(original: Played, tmp_path: Path) -> None:
    hardware = recorded(original.recording.path, from_s=0.0, speed=20.0)
    with running(tmp_path, {**hardware, "simulated": {"speed": "realtime"}}) as (bus, _):
        ended_ns = original.outcomes[-1].stamp_ns
        states = bus.latest(JOINT_STATE)
        try:
            pair = bus.call(CAPTURE, CaptureStereo(exposure_scale=2.0), DEADLINE_S)
            assert pair.stamp_ns == original.pair.stamp_ns
        except CommandRefused as late:  # a busy machine asked after it had passed
            assert "no picture is left" in late.text
        assert states.wait_for(lambda state: state.stamp_ns >= ended_ns, DEADLINE_S) is not None
