"""One assembly over the real processes: what came out, and what an independent reader finds in its recording."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader

from crosspih_common.config import cell_of_text
from crosspih_common.keys import WALL_CLOCK, commands, topics
from crosspih_common.messages import AssemblyPhase, AssemblyResult, Phase, Strategy, Touch
from crosspih_common.recording import read_recording
from crosspih_common.recording.rerun import Again, Rerun, begun_ns
from crosspih_common.recording.viewers import for_viewers
from services.force_torque.again import rerun as force_torque_again
from services.operator.assembly.session import Session
from services.operator.bench.cells.trials import WALL_FIGURES
from services.operator.recordings.export.layouts import for_cell
from services.operator.report import make_report
from services.operator.scoring.score import TrialFigures
from services.planning.again import ASKED as PLANNED
from services.planning.again import rerun as planning_again
from tests.foxglove.test_layouts import LAYOUTS, shown_wrongly
from tests.system.running_cell import RunningCell

SEED = 1000
PICTURES = ("camera/left/image", "camera/right/image", "vision/annotated/left", "vision/annotated/right")
STREAMS = ("clock", "arm/joint_state", "ft/raw", "force_torque/wrench", "simulation/truth")
STATES = ("camera/calibration", "force_torque/calibration")
# every command that an assembly needs; the others are asked only when a push did not enter
ASKED = (
    "arm/admittance_move",
    "arm/dwell",
    "arm/follow",
    "arm/guarded_move",
    "arm/move_linear",
    "arm/set_payload",
    "camera/capture",
    "force_torque/compensate",
    "inference/estimate",
    "inference/seated",
    "planning/assemble",
    "vision/locate",
)
Settings = dict[str, dict[str, float]]
WALL_ECHOES = (WALL_CLOCK.request_echo.path, WALL_CLOCK.reply_echo.path)


@dataclass
class File:
    """A recording as the mcap library reads it, without our code: by path below `crosspih/<cell>/`."""

    payloads: dict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    sequences: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    encodings: dict[str, str] = field(default_factory=dict)
    schemas: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Trial:
    """A finished assembly and everything about it."""

    figures: TrialFigures
    result: AssemblyResult
    phases: list[AssemblyPhase]
    touches: list[Touch]
    file: File


def read(path: Path, cell: str) -> File:
    file = File()
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        for index, channel in summary.channels.items():
            if for_viewers(channel.topic):
                continue
            below = channel.topic.removeprefix(f"crosspih/{cell}/")
            assert below != channel.topic, f"a key of another cell: {channel.topic}"
            file.counts[below] = summary.statistics.channel_message_counts[index]
            file.encodings[below] = channel.message_encoding
            file.schemas[below] = summary.schemas[channel.schema_id].name
        for _, channel, message in reader.iter_messages():
            if for_viewers(channel.topic):
                continue
            below = channel.topic.removeprefix(f"crosspih/{cell}/")
            file.payloads[below].append(message.data)
            file.sequences[below].append(message.sequence)
        file.metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
    return file


@pytest.fixture(scope="module")
def trial(cell: RunningCell) -> Trial:
    phases: list[AssemblyPhase] = []
    touches: list[Touch] = []
    with cell.session() as session:
        session.follow_events(phases.append, touches.append, lambda event: None)
        begun: list[int] = []
        figures, result = session.trial(SEED, Strategy.FUSED, record=True, on_begin=begun.append)
    assert figures.recording is not None
    return Trial(
        figures,
        result,
        # whoever comes late is told the last of the assembly before
        [phase for phase in phases if phase.stamp_ns > begun[0]],
        [touch for touch in touches if touch.stamp_ns > begun[0]],
        read(Path(figures.recording), cell.name),
    )


def test_the_peg_is_in_and_the_found_pose_is_the_true_one(trial: Trial) -> None:
    figures = trial.figures
    assert figures.inserted and figures.failure is None, figures
    assert figures.seed == SEED
    assert figures.vision_error_mm is not None and figures.vision_error_mm < 0.5
    assert figures.final_error_mm is not None and figures.final_error_mm < 0.15
    assert figures.final_error_deg is not None and figures.final_error_deg < 0.6
    assert figures.insertion_depth_mm is not None and figures.insertion_depth_mm > 15.0
    assert 0.0 < figures.peak_force_n < 60.0 and 0.0 < figures.peak_moment_nm < 6.0
    assert figures.pushes >= 1 and figures.presses == 4
    assert figures.duration_s == pytest.approx(figures.motion_s + figures.thinking_s, abs=1e-3)
    assert figures.motion_s > 0.0 and figures.thinking_s > 0.0


def test_each_step_is_told(trial: Trial) -> None:
    told = {phase.phase for phase in trial.phases}
    assert {Phase.LOCATING, Phase.APPROACHING, Phase.PUSHING, Phase.SEATED, Phase.DONE} <= told
    assert len(trial.touches) == trial.result.touches + trial.result.presses


def test_the_recording_lies_in_the_cells_own_folder(cell: RunningCell, trial: Trial) -> None:
    assert trial.figures.recording is not None
    assert Path(trial.figures.recording).parent == cell.recordings


def test_every_channel_is_there(trial: Trial) -> None:
    have = set(trial.file.counts)
    assert {*PICTURES, *STREAMS, *STATES} <= have
    assert {f"{path}/{end}" for path in ASKED for end in ("request", "reply")} <= have
    assert {
        f"service/{name}/status" for name in ("hardware", "vision", "force_torque", "inference", "planning")
    } <= have
    known = [re.compile(re.escape(topic.path).replace(r"\{service\}", "[a-z_]+")) for topic in topics()]
    for path in have:
        assert any(pattern.fullmatch(path) for pattern in known), path


def test_every_topic_and_field_of_the_layouts_is_there(trial: Trial, tmp_path: Path) -> None:
    assert trial.figures.recording is not None
    recording = Path(trial.figures.recording)
    for layout in LAYOUTS:
        named = tmp_path / layout.name
        named.write_text(for_cell(layout.read_text(encoding="utf-8"), read_recording(recording, []).cell))
        assert shown_wrongly(named, recording) == []


def test_the_counts_are_those_of_the_assembly(trial: Trial) -> None:
    counts = trial.file.counts
    assert counts == {path: len(payloads) for path, payloads in trial.file.payloads.items()}
    assert counts["planning/assemble/request"] == counts["planning/assemble/reply"] == 1
    assert counts["planning/phase"] == len(trial.phases)
    assert counts["planning/touch"] == len(trial.touches)
    for picture in PICTURES:
        assert counts[picture] == counts["vision/locate/reply"]
    # every motion's stream, from the table's rates and the motion on the cell's clock
    motion_s = trial.result.motion_s
    assert counts["arm/joint_state"] >= 250 * motion_s - 1
    assert counts["ft/raw"] >= 100 * motion_s - 1
    assert counts["clock"] >= 50 * motion_s - 1


def test_no_number_is_missing_on_any_channel(trial: Trial) -> None:
    # in their own order: what every service asks of the time while the recorder comes up may overtake its own past
    gaps = {
        path: wrong
        for path, sequences in trial.file.sequences.items()
        if (wrong := [pair for pair in pairwise(sorted(sequences) if path in WALL_ECHOES else sequences)
                      if pair[1] != pair[0] + 1])
    }  # fmt: skip
    assert not gaps


def test_nothing_was_dropped_on_the_way_to_the_file(trial: Trial) -> None:
    # restarts are no loss: other tests of this cell kill services, and the first word of the next process counts as one
    drops = trial.file.metadata["drops"]
    totals = {name: drops[f"{name}_total"] for name in ("overflow", "unwritten", "gaps", "malformed", "strays")}
    assert totals == dict.fromkeys(totals, "0")


def test_the_cells_file_is_in_the_recording(cell: RunningCell, trial: Trial) -> None:
    assert trial.file.metadata["cell"]["name"] == cell.name
    assert f"name: {cell.name}" in trial.file.metadata["cell"]["yaml"]


def test_small_messages_are_json_with_stamp_and_number(trial: Trial) -> None:
    types = {topic.path: topic.type.__name__ for topic in topics()}
    for path, payloads in trial.file.payloads.items():
        if path in PICTURES:
            continue
        assert trial.file.encodings[path] == "json"
        if path in types:
            assert trial.file.schemas[path] == f"crosspih.{types[path]}"
        for payload, sequence in zip(payloads, trial.file.sequences[path], strict=True):
            message = json.loads(payload)
            assert message["seq"] == sequence
            assert message["stamp_ns"] >= 0


@pytest.mark.parametrize("path", PICTURES)
def test_pictures_are_foxglove_raw_images(trial: Trial, path: str) -> None:
    assert trial.file.encodings[path] == "protobuf"
    assert trial.file.schemas[path] == "foxglove.RawImage"
    for payload in trial.file.payloads[path]:
        image = RawImage.FromString(payload)
        channels = {"mono8": 1, "rgb8": 3}[image.encoding]
        assert (image.width, image.height) == (640, 480)
        assert image.step == image.width * channels
        pixels = np.frombuffer(image.data, np.uint8)
        assert pixels.size == image.step * image.height
        assert pixels.std() > 1.0, "a picture of nothing"


def test_every_command_is_there_as_asked_and_as_answered(trial: Trial) -> None:
    file = trial.file
    for command in commands():
        asked, answered = (file.payloads.get(f"{command.path}/{end}", []) for end in ("request", "reply"))
        if command.path.startswith("recorder/") or command is WALL_CLOCK:
            continue  # the file ends, or begins, between a question and its answer
        assert len(asked) == len(answered), command.path
        for payload in asked:
            command.request.model_validate_json(payload)
        for payload in answered:
            command.reply.model_validate_json(payload)
    reply = AssemblyResult.model_validate_json(file.payloads["planning/assemble/reply"][0])
    assert reply == trial.result


def test_the_reports_page_tells_the_result(trial: Trial, tmp_path: Path) -> None:
    assert trial.figures.recording is not None
    page = tmp_path / "report.html"
    make_report(trial.figures.recording, page)
    text = page.read_text(encoding="utf-8")
    assert "inserted" in text.lower()
    assert f"{SEED}" in text
    assert text.count("data:image/webp;base64,") >= 2
    assert "<script src=" not in text and 'href="http' not in text
    assert f"{trial.figures.final_error_mm:.3f}" in text


WALL_TIMES = {"stamp_ns", "seq", "thinking_s"}


def test_the_same_seed_gives_the_same_trial_to_the_last_bit(session: Session, trial: Trial) -> None:
    def once() -> tuple[str, str, dict[str, object]]:
        figures, result = session.trial(SEED + 1, Strategy.FUSED, record=False)
        truth = session.truth()
        assert figures.inserted and truth is not None
        return (
            result.model_dump_json(exclude=WALL_TIMES),
            truth.model_dump_json(exclude={"stamp_ns", "seq"}),
            figures.model_dump(exclude=set(WALL_FIGURES)),
        )

    assert once() == once()


def test_vision_and_inference_answer_the_same_again(cell: RunningCell, trial: Trial) -> None:
    """Each asked on a router of its own, vision over a camera that gives the recorded pictures."""
    assert trial.figures.recording is not None
    done = cell.cli("replay", trial.figures.recording)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "vision: 1 of 1 recorded answers are equal bit for bit" in done.stdout
    asked = trial.file.counts["inference/estimate/reply"] + trial.file.counts["inference/seated/reply"]
    assert f"inference: {asked} of {asked} recorded answers are equal bit for bit" in done.stdout


# ----------------------------------------------------------------------------------------------- gone through again


def again(core: Again, trial: Trial, settings: Settings | None = None, without: str = "") -> Rerun:
    """The outcome of a service's core on the trial's recording, in its own cell with other settings of the service;
    `without` is a key of which one sample is lost."""
    assert trial.figures.recording is not None
    recording = read_recording(trial.figures.recording)
    for key, samples in recording.samples.items():
        if without and key.endswith(without):
            del samples[len(samples) * 7 // 8]  # well after a calibration, before which nothing is told
    outcome = Rerun(begun_ns(recording))
    content = yaml.safe_load(recording.metadata["cell"]["yaml"])
    for section, values in (settings or {}).items():
        content[section] = {**content.get(section, {}), **values}
    core(recording, cell_of_text(Path("cell.yaml"), yaml.safe_dump(content)), outcome.start_ns, outcome)
    return outcome


def test_force_torque_and_planning_say_and_decide_the_same_on_the_recording(trial: Trial) -> None:
    felt = again(force_torque_again, trial)
    assert felt.rows == [] and felt.notes == []
    equal, every = felt.parts["wrenches"]
    assert equal == every > 0.9 * trial.file.counts["force_torque/wrench"]
    answers = [trial.file.counts.get(f"force_torque/{path}/reply", 0) for path in ("compensate", "identify")]
    assert felt.parts["answers"] == [sum(answers)] * 2
    decided = again(planning_again, trial)
    assert decided.rows == [] and decided.notes == []
    asked = sum(trial.file.counts.get(f"{command.path}/request", 0) for command in PLANNED)
    assert decided.parts["requests"] == [asked, asked] and decided.parts["results"] == [1, 1]
    assert decided.parts["phases"] == [len(trial.phases)] * 2 and decided.parts["touches"] == [len(trial.touches)] * 2


def test_other_code_is_told_by_what_differs_first(trial: Trial) -> None:
    decided = again(planning_again, trial, {"planning": {"push_speed_m_s": 0.0123}})
    first = decided.rows[0]
    assert (first["asked"], first["field"], first["now"]) == ("arm/admittance_move", "speed_m_s", "0.0123")
    assert "the first decision that differs: arm/admittance_move" in decided.notes[0]
    felt = again(force_torque_again, trial, {"force_torque": {"filter_hz": 40.0}})
    assert felt.parts["wrenches"][0] == 0 and felt.parts["answers"][0] == felt.parts["answers"][1]


def test_a_sample_that_was_not_recorded_is_a_gap_and_no_difference(trial: Trial) -> None:
    for lost in ("ft/raw", "arm/joint_state", "force_torque/wrench"):
        felt = again(force_torque_again, trial, without=lost)
        assert felt.rows == [] and felt.parts["wrenches"][0] == felt.parts["wrenches"][1] > 0
    assert "samples are missing in 1 places" in again(force_torque_again, trial, without="ft/raw").notes[0]
