"""The real service on the in-memory bus, before a sensor that is mounted and wired in its own way."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.config import CellFile, Workcell, load_cell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import (
    CLOCK,
    COMPENSATE,
    CONTACT_WRENCH,
    EVENTS,
    FT_CALIBRATION,
    IDENTIFY_PAYLOAD,
    JOINT_STATE,
    WRENCH_RAW,
)
from crosspih_common.messages import (
    CellClock,
    CompensateWrench,
    FtCalibration,
    IdentifyPayload,
    JointState,
    PoseData,
    RawReading,
    RawWrenchBatch,
    SetPayload,
    floats,
)
from crosspih_common.service.lifecycle import ServiceContext
from crosspih_common.wrench import Payload, SensorMounting
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.judging import Judge
from services.force_torque.shell import ForceTorqueShell
from services.force_torque.stream import WrenchStream

DEADLINE_S = 10.0
BIAS = np.array([0.8, -0.5, 1.2, 0.03, -0.02, 0.01])
WEIGHT = np.array([0.0, 0.0, -9.55])
CENTROID = np.array([0.001, -0.0005, 0.033])
# the sensor as it really is: turned, behind the peg's frame, reporting the reaction in mN
REAL: dict[str, Any] = {
    "reports": "reaction",
    "axes": ["-y", "x", "z"],
    "force_unit": "mN",
    "moment_unit": "mNm",
    "pose_flange_sensor": {"position_m": [0.0, 0.001, 0.0363], "rotvec_rad": [0.0, 0.0, 0.5]},
    "correction": {"turn_rad": [0.05, 0.0, 0.0], "shift_m": [0.001, 0.0, 0.0]},
}
SPREAD: list[list[float]] = [
    [0, 0, 0], [np.pi, 0, 0], [np.pi / 2, 0, 0], [-np.pi / 2, 0, 0.4], [0, np.pi / 2, 0], [0, -np.pi / 2, 1],
]  # fmt: skip


def mounting(section: dict[str, Any]) -> SensorMounting:
    return Workcell.model_validate({"force_torque": section}).sensor_mounting()


SENSOR = Payload(BIAS, WEIGHT, CENTROID, mounting(REAL))


@dataclass
class Service:
    """The service, and the hardware's and the planner's places on the bus."""

    cell: CellFile
    hardware: Bus
    planning: Bus
    stamp_ns: int = 1_000_000_000

    def stream(self, raw: Array, period_s: float, duration_s: float) -> None:
        """The arm stands at home; a batch of 8 ms (at least one sample) and a joint state at a time."""
        count = max(1, round(0.008 / period_s))
        for _ in range(round(duration_s / (count * period_s))):
            self.hardware.publisher(JOINT_STATE).publish(
                JointState(
                    stamp_ns=self.stamp_ns, joints_rad=self.cell.workcell.home_joints_rad, speeds_rad_s=(0.0,) * 6
                )
            )
            self.hardware.publisher(WRENCH_RAW).publish(
                RawWrenchBatch(stamp_ns=self.stamp_ns, period_ns=round(period_s * 1e9), samples=(floats(raw),) * count)
            )
            self.stamp_ns += round(count * period_s * 1e9)

    def rotation(self) -> Array:
        """The peg frame at home."""
        return self.cell.workcell.pose_base_peg(self.cell.workcell.home_joints_rad).rotation

    def identify(self, sensor: Payload, poses: list[list[float]] = SPREAD) -> FtCalibration:
        """A calibration with what a sensor says in six poses."""
        rotations = Rotation.from_rotvec(poses).as_matrix()
        readings = tuple(
            RawReading(
                pose_base_peg=PoseData.of(Pose(rotation, np.zeros(3))),
                wrench_raw=floats(sensor.mounting.raw(sensor.load(rotation))),
                wrench_sd=(0.01,) * 6,
            )
            for rotation in rotations
        )
        return self.planning.call(IDENTIFY_PAYLOAD, IdentifyPayload(readings=readings), DEADLINE_S)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[dict[str, Any]], Service]]:
    closing: list[Bus] = []

    def begin(section: dict[str, Any]) -> Service:
        hub, cell = MemoryHub(), load_cell("deploy/cells/default.yaml")
        cell = replace(cell, workcell=Workcell.model_validate({"force_torque": section}))
        hardware, service, planning = (
            Bus(hub.transport(), cell.workcell.name, name) for name in ("hardware", "force_torque", "planning")
        )
        closing.extend((planning, service, hardware))
        ForceTorqueShell(
            ServiceContext("force_torque", cell, service), ForceTorqueConfig(calibration_file=str(tmp_path / "ft.yaml"))
        )
        begun = Service(cell, hardware, planning)
        hardware.publisher(CLOCK).publish(CellClock(stamp_ns=begun.stamp_ns, boot_id="a", realtime=False))
        return begun

    yield begin
    for bus in closing:
        bus.close()


@pytest.mark.parametrize("period_s", [0.008, 0.001, 1 / 8000])
def test_arm_and_service_tell_one_number_for_any_sensor(
    start: Callable[[dict[str, Any]], Service], period_s: float
) -> None:
    service = start(REAL)
    told = service.identify(SENSOR)
    # the arm has no more than the command that the planner sends it, and the cell's file
    command = SetPayload(
        bias=told.bias, weight_n=told.weight_n, centroid_ft_m=told.centroid_m, gravity_base=told.gravity_base
    )
    arm = Payload.from_command(command, service.cell.workcell.sensor_mounting())
    push, rotation = np.array([3.0, -2.0, -8.0, 0.1, 0.2, -0.05]), service.rotation()
    raw = SENSOR.mounting.raw(push + SENSOR.load(rotation))
    felt = arm.contact(raw, rotation)
    assert felt == pytest.approx(push, abs=1e-6)
    reply = service.planning.call(
        COMPENSATE,
        CompensateWrench(
            pose_base_peg=PoseData.of(Pose(rotation, np.zeros(3))), wrench_raw=floats(raw), wrench_sd=(1.0,) * 6
        ),
        DEADLINE_S,
    )
    assert reply.wrench == pytest.approx(floats(felt), abs=1e-12)
    assert max(reply.wrench_sd) < 0.01  # told in mN
    contacts = service.planning.latest(CONTACT_WRENCH)
    service.stream(raw, period_s, 0.3)
    last_ns = service.stamp_ns - round(period_s * 1e9)
    latest = contacts.wait_for(lambda one: abs(one.stamp_ns - last_ns) < 1000, DEADLINE_S)
    assert latest is not None and latest.in_contact
    assert latest.wrench == pytest.approx(floats(felt), abs=1e-9)


def test_a_turned_sensor_is_refused_with_the_lines_that_mend_it(
    start: Callable[[dict[str, Any]], Service], tmp_path: Path
) -> None:
    drawn = {name: value for name, value in REAL.items() if name != "pose_flange_sensor"}
    straight = {**REAL, "pose_flange_sensor": {"position_m": [0.0, 0.0, 0.0663]}}
    with pytest.raises(CommandRefused, match=r"turned by 28\.\d degrees about its z axis") as refusal:
        start(straight).identify(SENSOR)
    mend = refusal.value.text
    turn = [float(value) for value in mend[mend.index("rotvec_rad: [") + 13 : mend.rindex("]")].split(",")]
    assert turn == pytest.approx(REAL["pose_flange_sensor"]["rotvec_rad"], abs=0.002)
    assert not (tmp_path / "ft.yaml").exists()
    mended = {**drawn, "pose_flange_sensor": {"position_m": [0.0, 0.001, 0.0363], "rotvec_rad": turn}}
    assert start(mended).identify(SENSOR).weight_n == pytest.approx(9.55, abs=0.01)


def test_a_calibration_that_the_resting_sensor_belies_is_refused(
    start: Callable[[dict[str, Any]], Service], tmp_path: Path
) -> None:
    service = start(REAL)
    shifted = Payload(BIAS + np.array([-55.0, 0, 0, 0, 0, 0]), WEIGHT, CENTROID, SENSOR.mounting)
    raws, contacts = SENSOR.mounting.raw(SENSOR.load(service.rotation())), service.planning.latest(CONTACT_WRENCH)
    service.identify(SENSOR)
    service.stream(raws, 0.001, 0.3)
    last_ns = service.stamp_ns - 1_000_000
    assert contacts.wait_for(lambda one: one.stamp_ns == last_ns, DEADLINE_S) is not None
    with pytest.raises(CommandRefused, match=r"at rest it leaves 55\.00 N") as refusal:
        service.identify(shifted)
    assert refusal.value.code == "implausible_payload"
    assert service.identify(SENSOR).weight_n == pytest.approx(9.55, abs=0.01)


def test_a_calibration_of_another_peg_is_not_used_though_it_has_the_same_name(
    start: Callable[[dict[str, Any]], Service], tmp_path: Path
) -> None:
    start(REAL).identify(SENSOR)
    kept = yaml.safe_load((tmp_path / "ft.yaml").read_text())
    assert kept["peg"]["outline"] == "cross" and kept["warnings"] == []
    kept["peg"]["corners_m"] = [[1.1 * x, 1.1 * y] for x, y in kept["peg"]["corners_m"]]
    (tmp_path / "ft.yaml").write_text(yaml.safe_dump(kept))
    said = start(REAL).planning.latest(EVENTS).wait_for(lambda one: one.code == "calibration_file", DEADLINE_S)
    assert said is not None and "made with another peg ('cross', by its contour" in said.text


def test_copies_of_a_pose_count_once(start: Callable[[dict[str, Any]], Service]) -> None:
    with pytest.raises(CommandRefused, match=r"5 poses that are no copies of another \(7 were given\)"):
        start(REAL).identify(SENSOR, [*SPREAD[:5], SPREAD[1], SPREAD[1]])
    assert start(REAL).identify(SENSOR, [*SPREAD, SPREAD[1]]).poses == 6


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (Payload(BIAS, 1000.0 * WEIGHT, CENTROID / 1000.0), r"weight_n: 9\.55e\+03 N .* beyond the sensor's range"),
        (Payload(BIAS, WEIGHT, np.array([0.0, 0.0, 2.0])), r"centroid: 2 m from the sensor"),
        (
            Payload(BIAS, WEIGHT, np.array([0.0, 0.0, 0.3])),
            r"centroid: 300 mm ahead .* by its drawing the peg ends at 80 mm",
        ),
        (Payload(BIAS, WEIGHT, np.array([0.2, 0.0, 0.03])), r"by its drawing the peg reaches 28 mm from its axis"),
        (Payload(BIAS, -WEIGHT, CENTROID), r"the weight found points up"),
    ],
)
def test_what_cannot_hang_on_the_sensor_is_refused(
    start: Callable[[dict[str, Any]], Service], payload: Payload, words: str
) -> None:
    with pytest.raises(CommandRefused, match=words):
        start({}).identify(payload)


def test_no_calibration_is_lost_to_a_stream(start: Callable[[dict[str, Any]], Service]) -> None:
    service = start({})
    config = ForceTorqueConfig()
    stream = WrenchStream(service.cell.workcell, config, Judge(service.cell.workcell, config.contact_classifier))
    batch = RawWrenchBatch(stamp_ns=1, period_ns=1_000_000, samples=((0.0,) * 6,) * 8)
    home = JointState(stamp_ns=1, joints_rad=service.cell.workcell.home_joints_rad, speeds_rad_s=(0.0,) * 6)
    done = threading.Event()

    def go_on() -> None:
        while not done.is_set():
            stream.take(batch, [home])

    streaming = threading.Thread(target=go_on)
    streaming.start()
    lost = 0
    try:
        for index in range(200):
            stream.use(Payload(BIAS + index, WEIGHT, CENTROID), index)
            told = stream.take(batch, [home]).wrench
            lost += stream.payload.bias[0] != BIAS[0] + index or told.calibration_seq != index
    finally:
        done.set()
        streaming.join()
    assert lost == 0


def test_a_slow_sensors_batches_are_filtered_by_their_own_period(start: Callable[[dict[str, Any]], Service]) -> None:
    workcell, config = start({}).cell.workcell, ForceTorqueConfig()
    home = JointState(stamp_ns=1, joints_rad=workcell.home_joints_rad, speeds_rad_s=(0.0,) * 6)
    felt = []
    for period_ns in (1_000_000, 4_000_000):
        stream = WrenchStream(workcell, config, Judge(workcell, config.contact_classifier))
        stream.use(Payload(np.zeros(6), np.zeros(3), np.zeros(3)), 0)
        quiet, push = (0.0,) * 6, (0.0, 0.0, 0.9, 0.0, 0.0, 0.0)
        for stamp_ns, sample in ((0, quiet), (4_000_000, push)):
            batch = RawWrenchBatch(stamp_ns=stamp_ns, period_ns=period_ns, samples=(sample,) * (4_000_000 // period_ns))
            told = stream.take(batch, [home])
        felt.append(told.wrench.wrench[2])
    # 4 ms of a push, in four samples or in one
    assert felt[0] == pytest.approx(felt[1], rel=1e-9)
    assert felt[0] == pytest.approx(0.9 * (1.0 - np.exp(-2.0 * np.pi * config.filter_hz * 0.004)), rel=1e-9)


def test_a_calibration_of_another_mounting_is_not_used_again(start: Callable[[dict[str, Any]], Service]) -> None:
    start(REAL).identify(SENSOR)
    again = start(REAL).planning.latest(FT_CALIBRATION).wait_for(lambda one: one.calibrated, DEADLINE_S)
    assert again is not None and again.weight_n == pytest.approx(9.55, abs=0.01)
    other = start({**REAL, "correction": {"turn_rad": [0.04, 0.0, 0.0]}})
    said = other.planning.latest(EVENTS).wait_for(lambda one: one.code == "calibration_file", DEADLINE_S)
    assert said is not None and "has changed since this calibration" in said.text
    with pytest.raises(CommandRefused, match="not_calibrated"):
        other.planning.call(
            COMPENSATE,
            CompensateWrench(pose_base_peg=PoseData.of(Pose.identity()), wrench_raw=(0.0,) * 6, wrench_sd=(0.0,) * 6),
            DEADLINE_S,
        )
