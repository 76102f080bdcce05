"""The sequence network: its touches are the mechanics', peg and hole look alike after their symmetries, it learns from
few histories what it should, and it answers on the bus."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="set-up left torch out")

from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import SEQUENCE_NETWORK
from crosspih_common.messages import ContactState, EstimateBySequence, PoseData, PosePrior, Touch, floats
from crosspih_common.service import ServiceContext
from crosspih_common.shapes import CrossPeg
from services.inference.estimator import TouchObservation
from services.inference.network.sequence.comparison import PRIORS, as_text, compare, observations, world_of
from services.inference.network.sequence.data import SequenceDataset, TouchWorld, touch_sequences
from services.inference.network.sequence.model import (
    SequenceNetwork,
    SequenceTraining,
    history_of,
    train_sequence_network,
)
from services.inference.network.sequence.touch_features import FEATURES, symmetries, touch_features, turn_pose_error
from services.inference.network.settings import SEQUENCE_WEIGHTS
from services.inference.shell.sequence_network import SequenceShell

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)
CLEAN = TouchWorld(force_sd_n=0.0, moment_sd_nm=0.0, place_sd_m=0.0, turn_error_sd_rad=0.0)


@pytest.fixture(scope="module")
def histories() -> SequenceDataset:
    return touch_sequences(PEG, HOLE, 60, 3, np.random.default_rng(1), CLEAN)


def test_histories_are_whole_and_repeat(histories: SequenceDataset) -> None:
    again = touch_sequences(PEG, HOLE, 60, 3, np.random.default_rng(1), CLEAN)
    assert again.sha256() == histories.sha256() and len(again) == 60
    force = np.linalg.norm(histories.history.wrench[..., :3], axis=-1)
    assert force.min() >= 6.0 and force.max() <= 20.0
    # each is one force through one point: no couple is left along it
    pitch = np.einsum("nki,nki->nk", histories.history.wrench[..., :3], histories.history.wrench[..., 3:])
    assert np.abs(pitch).max() < 1e-9
    assert np.all(np.abs(histories.error) <= 2.5 * histories.history.prior_sd + 1e-12)


def test_a_cross_has_eight_symmetries() -> None:
    turns = symmetries(PEG)
    assert len(turns) == 8 and np.array_equal(turns[0], np.eye(3))
    assert sorted(np.round(np.linalg.det(turns)).tolist()) == [-1.0] * 4 + [1.0] * 4


def test_a_symmetry_of_the_hole_is_one_of_the_history(histories: SequenceDataset) -> None:
    """Turned and turned back is what it was; and the features' scalars do not notice."""
    before = touch_features(PEG, histories.history)
    for turn in symmetries(PEG):
        turned = histories.history.turned(np.broadcast_to(turn, (60, 3, 3)))
        back = turned.turned(np.broadcast_to(turn.T, (60, 3, 3)))
        assert back.wrench == pytest.approx(histories.history.wrench, abs=1e-12)
        assert back.rotation == pytest.approx(histories.history.rotation, abs=1e-12)
        after = touch_features(PEG, turned)
        # size of the force, and how far it passes the nearest edge
        assert after[..., 15] == pytest.approx(before[..., 15], abs=1e-5)
        assert after[..., 2] == pytest.approx(before[..., 2], abs=1e-5)
        error = turn_pose_error(turn, histories.error)
        assert np.linalg.norm(error[:, :3], axis=1) == pytest.approx(np.linalg.norm(histories.error[:, :3], axis=1))


def test_the_line_of_action_meets_the_edge_that_touches(histories: SequenceDataset) -> None:
    """Most contacts are on a taper edge; there the line passes it within a micrometre (the feature's floor: 10)."""
    miss = touch_features(PEG, histories.history)[..., 25]
    assert np.mean(miss < np.log(2e-5 / 1e-3) / 3.0) > 0.5


def test_features_have_the_order_of_one(histories: SequenceDataset) -> None:
    features = touch_features(PEG, histories.history)
    assert features.shape == (60, 3, FEATURES) and np.isfinite(features).all() and np.abs(features).max() < 10.0


def test_training_repeats_improves_and_is_kept(tmp_path: Path) -> None:
    data = touch_sequences(PEG, HOLE, 200, 2, np.random.default_rng(3))
    settings = SequenceTraining(epochs=4, batch=20)
    networks = [train_sequence_network(PEG, data, 5, "test", settings) for _ in range(2)]
    first, second = (network.predict(data.history) for network in networks)
    assert np.array_equal(first[0], second[0]) and np.array_equal(first[1], second[1])
    record = networks[0].record
    assert record.validation_nll[-1] < record.validation_nll[0] - 0.1 and record.sequences == 200
    networks[0].save(tmp_path / "sequence.safetensors")
    loaded = SequenceNetwork.load(tmp_path / "sequence.safetensors", PEG)
    assert loaded.record == record and np.array_equal(loaded.predict(data.history)[0], first[0])
    with pytest.raises(ValueError, match="another peg"):
        SequenceNetwork.load(tmp_path / "sequence.safetensors", CrossPeg(half_width_m=0.008))
    with pytest.raises(ValueError, match="at least 20"):
        train_sequence_network(PEG, data.rows(slice(0, 5)), 0, "test")


def left_after(found: Array, truth: Array) -> tuple[float, float]:
    """Median lateral error, mm, and rotation, degrees."""
    off = found - truth
    return float(np.median(np.hypot(off[:, 0], off[:, 1])) * 1e3), float(
        np.degrees(np.median(np.linalg.norm(off[:, 3:], axis=1)))
    )


def test_the_shipped_network_narrows_the_pose_with_each_touch() -> None:
    network = SequenceNetwork.load(SEQUENCE_WEIGHTS, PEG)
    data = touch_sequences(PEG, HOLE, 80, 4, np.random.default_rng(77), world_of((1e-3, 3e-3, 0.0524, 0.0087), 0.1))
    mean, covariance = network.predict(data.history)
    prior = left_after(np.zeros_like(data.error), data.error)
    one, four = left_after(mean[:, 0], data.error), left_after(mean[:, 3], data.error)
    assert one[0] < prior[0] and four[0] < 0.35 * prior[0] and four[1] < 0.4 * prior[1]
    distance = np.einsum("ni,ni->n", data.error - mean[:, 3], np.linalg.solve(
        covariance[:, 3], (data.error - mean[:, 3])[..., None])[..., 0])  # fmt: skip
    assert np.mean(distance < 12.59) > 0.7
    command = network.record.command
    assert command.startswith("python -m services.inference.network sequence") and f"--seed {network.record.seed}" in (
        command
    )


def test_it_moves_with_the_base_and_the_estimator_sees_the_same_touches() -> None:
    world = world_of((1e-3, 3e-3, 0.0524, 0.0087), 0.1)
    data = touch_sequences(PEG, HOLE, 3, 2, np.random.default_rng(8), world)
    network = SequenceNetwork.load(SEQUENCE_WEIGHTS, PEG)
    prior = Pose.from_rotvec([0.3, -0.2, 1.0], [0.4, -0.3, 0.2])
    felt = observations(data, 1, world)
    history = history_of(
        prior,
        data.history.prior_sd[1],
        [prior @ touch.deflected_pose_base_peg() for touch in felt],
        [touch.wrench_peg for touch in felt],
        [prior.rotate(touch.motion_direction_base) for touch in felt],
    )
    assert history.translation_m == pytest.approx(data.history.translation_m[1], abs=1e-9)
    pose, covariance = network.pose(prior, history)
    mean, _ = network.predict(data.history)
    expected = prior @ Pose.from_rotvec(mean[1, -1, 3:], mean[1, -1, :3])
    assert pose.distance_to_m(expected) < 1e-6 and pose.angle_to_rad(expected) < 1e-5
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


def test_the_comparison_says_what_each_found() -> None:
    said: list[int] = []
    result = compare(Workcell(), None, 3, 1, 5, lambda doing, done, total: said.append(done))
    assert said == list(range(1, 7))
    for prior in PRIORS:
        ways = result[prior]
        assert ways["estimator"]["lateral_mm_p50"][0] < ways["no touch"]["lateral_mm_p95"][0] * 2.0
        assert 0.0 <= ways["sequence network"]["truth_in_95_region"][0] <= 1.0
        assert prior in as_text(result)


def shell(weights: str) -> tuple[Bus, list[ServiceContext]]:
    hub, cell = MemoryHub(), load_cell("deploy/cells/default.yaml")
    contexts = [ServiceContext(name, cell, Bus(hub.transport(), cell.workcell.name, name))
                for name in ("inference", "planning")]  # fmt: skip

    def observation(touch: Touch) -> TouchObservation:
        return TouchObservation(
            touch.pose_base_peg.pose(), np.asarray(touch.wrench), np.asarray(touch.wrench_sd), np.eye(6) * 1e-9,
            np.asarray(touch.direction_base),
        )  # fmt: skip

    SequenceShell(contexts[0], weights, observation)
    return contexts[1].bus, contexts


def request(prior: Pose, touches: int) -> EstimateBySequence:
    state = ContactState(case=None, n_z0=0.3, confidence=0.0)
    wrench = (-19.247, -0.785, -5.3953, -0.044, -1.244, 0.339)
    peg = prior @ Pose.from_translation([0.0, 0.0, -PEG.tip_m + 0.012])
    return EstimateBySequence(
        prior=PosePrior(pose_base_hole=PoseData.of(prior), covariance=floats(np.diag([1e-6] * 3 + [1e-3] * 3))),
        touches=tuple(
            Touch(
                index=index, pose_base_peg=PoseData.of(peg), direction_base=floats(prior.rotation[:, 2]),
                joints_rad=(0.0,) * 6, wrench=wrench, wrench_sd=(0.02,) * 3 + (0.001,) * 3, state=state,
            )
            for index in range(touches)
        ),
    )  # fmt: skip


def test_it_answers_on_the_bus_and_the_same_twice() -> None:
    bus, contexts = shell("")
    prior = Pose.from_rotvec([0.1, 0.2, 0.3], [0.4, -0.3, 0.2])
    first, second = (bus.call(SEQUENCE_NETWORK, request(prior, 2), 30.0) for _ in range(2))
    assert first.pose_base_hole == second.pose_base_hole and first.method == "sequence"
    assert [use.index for use in first.rests_on] == [0, 1] and first.rank >= 1
    assert first.pose_base_hole.pose().distance_to_m(prior) < 0.01
    for context in contexts:
        context.bus.close()


def test_without_weights_it_refuses(tmp_path: Path) -> None:
    (tmp_path / "other.safetensors").write_bytes(b"no weights at all, but as long as a header")
    bus, contexts = shell(str(tmp_path / "other.safetensors"))
    with pytest.raises(CommandRefused, match="no sequence network"):
        bus.call(SEQUENCE_NETWORK, request(Pose.identity(), 1), 30.0)
    for context in contexts:
        context.bus.close()
