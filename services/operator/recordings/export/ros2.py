"""`crosspih recording export ros2`: a recording as a ROS 2 bag, with the topics that the bridge publishes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.bus.codec import decode
from crosspih_common.config import CellFile
from crosspih_common.errors import ConfigError, ContractError
from crosspih_common.keys import (
    ASSEMBLE,
    CAMERA_CALIBRATION,
    CLOCK,
    CONTACT_WRENCH,
    EVENTS,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    LOCATE,
    STATUS,
    WRENCH_RAW,
    Topic,
)
from crosspih_common.recording import Recorded, Recording, read_recording
from crosspih_common.ros2 import RosTypes
from crosspih_common.ros2.frames import ros_arm
from crosspih_common.ros2.topics import Topics
from crosspih_common.ros2.types import DISTROS, Distro
from services.operator.bench.options import errors_shown
from services.operator.recordings.export.bag import Bag
from services.operator.recordings.export.shown import cell_of

DIAGNOSE_NS = 1_000_000_000
# each topic with the method of Topics that takes it
HEARD: tuple[tuple[Topic[Any], str], ...] = (
    (CLOCK, "clock"),
    (JOINT_STATE, "joint_state"),
    (WRENCH_RAW, "raw_batch"),
    (CONTACT_WRENCH, "contact_wrench"),
    (CAMERA_CALIBRATION, "calibration"),
    (IMAGE_LEFT, "left_image"),
    (IMAGE_RIGHT, "right_image"),
    (STATUS, "status"),
    (EVENTS, "event"),
    (LOCATE.reply_echo, "hole"),
    (ASSEMBLE.reply_echo, "assembled"),
)


def ros2(
    recording: Annotated[Path, typer.Argument(help="A recording (.mcap), also one that was torn off.")],
    out: Annotated[Path, typer.Argument(help="The bag: a folder that is made, with metadata.yaml and an .mcap in it.")],
    distro: Annotated[str, typer.Option(help="Whose message definitions: humble, jazzy, kilted or lyrical.")] = "jazzy",
    tf_hz: Annotated[float, typer.Option(min=0.0, max=500.0, help="Of the arm's links on /tf.")] = 50.0,
    cell_stamps: Annotated[bool, typer.Option("--cell-stamps", help="The cell's own time, not the wall's.")] = False,
) -> None:
    """Write a recording as a ROS 2 bag (MCAP, CDR): for `ros2 bag play`, rosbags, PlotJuggler and others."""
    console = Console()
    with errors_shown(console):
        if distro not in DISTROS:
            raise ConfigError(f"--distro {distro}: want {', '.join(DISTROS)}")
        if out.exists():
            raise ConfigError(f"{out}: is there already; name a folder that is not")
        read = read_recording(recording, [topic for topic, _ in HEARD])
        counts = write_bag(read, out, distro, tf_hz, cell_stamps)
        if not read.finished:
            console.print(
                f"{recording}: is damaged ({read.tear}); its undamaged messages are in the bag", highlight=False
            )
        for line in read.problems:
            console.print(f"left out: {line}", highlight=False, markup=False)
        for name, count in counts.items():
            console.print(f"{count:8d}  {name}", highlight=False)


def write_bag(
    recording: Recording, out: Path, distro: Distro, tf_hz: float = 50.0, cell_stamps: bool = False
) -> dict[str, int]:
    """Write the bag; returns how many messages each topic has. What cannot be decoded is listed in
    `recording.problems`.

    Raises ConfigError where the recording names no cell, or has none of the topics.
    """
    cell, types = cell_of(recording), RosTypes(distro)
    samples = sorted(
        ((sample, topic, method) for topic, method in HEARD for key in recording.keys_of(topic)
         for sample in recording.samples[key]),
        key=lambda entry: entry[0].wall_ns,
    )  # fmt: skip
    if not samples:
        raise ConfigError(f"{recording.path}: nothing in it that ROS 2 has a message for")
    with Bag(out, types) as bag:
        bag.now_ns = _time_of(samples[0][0], cell_stamps)
        arm = ros_arm(cell.workcell, "ros2", **_names(cell))
        stamps = "cell" if cell_stamps else "wall"
        topics = Topics(bag, arm, cell.workcell, lambda: bag.now_ns, stamps=stamps, tf_hz=tf_hz)  # type: ignore[arg-type]
        next_ns = bag.now_ns + DIAGNOSE_NS
        for sample, topic, method in samples:
            bag.now_ns = max(bag.now_ns, _time_of(sample, cell_stamps))
            if bag.now_ns >= next_ns:
                topics.diagnose()
                next_ns = bag.now_ns + DIAGNOSE_NS
            try:
                value = decode(topic.type, sample.payload, sample.label, sample.key)
            except ContractError as error:
                recording.problems.append(str(error))
                continue
            getattr(topics, method)(value)
        return dict(bag.counts)


def _time_of(sample: Recorded, cell_stamps: bool) -> int:
    return sample.stamp_ns if cell_stamps else sample.wall_ns


def _names(cell: CellFile) -> dict[str, Any]:
    """The names that the bridge's section of the cell's file sets."""
    section = cell.sections.get("ros2", {})
    wanted = {"joint_names": "joint_names", "base_frame": "base", "flange_frame": "flange"}
    return {name: section[field] for field, name in wanted.items() if section.get(field) is not None}
