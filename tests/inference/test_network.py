"""The paper's network: traingdx reaches its goal on the ten printed rows; files keep what they were given."""

from pathlib import Path

import numpy as np
import pytest
import torch

from crosspih_common.geometry import Pose, rotation_to_error_angles
from crosspih_common.shapes import CrossHole, CrossPeg
from services.inference.network.dataset import ContactDataset
from services.inference.network.estimator import SHIPPED_WEIGHTS, NetworkEstimator, NetworkUnavailable
from services.inference.network.model import AngleNetwork, train
from services.inference.network.synthesis import single_contact_dataset
from services.inference.network.traingdx import TrainGdx
from tests.inference.paper_tables import TABLE_6, TABLE_7_RAD, paper_dataset


def test_ten_rows_reach_the_goal_and_stay_within_a_degree() -> None:
    network = train(paper_dataset(), seed=0, command="test")
    assert network.record.reached_goal and network.record.mse_scaled <= 1e-3 and network.record.epochs < 1000
    assert np.degrees(np.abs(network.predict(TABLE_6) - TABLE_7_RAD)).max() < 1.0


def test_same_seed_same_network_and_the_file_keeps_it(tmp_path: Path) -> None:
    first, second = (train(paper_dataset(), seed=5, command="test", epochs=40) for _ in range(2))
    assert np.array_equal(first.predict(TABLE_6), second.predict(TABLE_6))
    first.save(tmp_path / "network.safetensors")
    loaded = AngleNetwork.load(tmp_path / "network.safetensors")
    assert loaded.record == first.record and loaded.record.dataset_sha256 == paper_dataset().sha256()
    assert loaded.predict(TABLE_6) == pytest.approx(first.predict(TABLE_6), abs=1e-12)


def test_traingdx_throws_a_worsening_step_away() -> None:
    weight = torch.nn.Parameter(torch.tensor([1.0], dtype=torch.float64))
    optimiser = TrainGdx([weight], lr=100.0, momentum=0.0)

    def closure() -> float:
        optimiser.zero_grad()
        error = (weight**2).sum()
        error.backward()  # type: ignore[no-untyped-call]
        return float(error.detach())

    optimiser.step(closure)
    assert weight.item() == 1.0 and optimiser.param_groups[0]["lr"] == pytest.approx(70.0)
    for _ in range(200):
        optimiser.step(closure)
    assert abs(weight.item()) < 0.2
    with pytest.raises(ValueError, match="closure"):
        optimiser.step()


def test_dataset_file_and_its_complaints(tmp_path: Path) -> None:
    dataset = paper_dataset()
    dataset.save(tmp_path / "rows.npz")
    assert ContactDataset.load(tmp_path / "rows.npz").sha256() == dataset.sha256()
    np.savez(tmp_path / "short.npz", wrench=TABLE_6)
    with pytest.raises(ValueError, match="angles_rad"):
        ContactDataset.load(tmp_path / "short.npz")
    with pytest.raises(ValueError, match="state"):
        ContactDataset(TABLE_6, TABLE_7_RAD, np.zeros((10, 3)), np.array(["1-2-2"]))


def test_shipped_weights_answer_with_a_pose_that_explains_the_wrench() -> None:
    peg = CrossPeg()
    hole = CrossHole.around(peg, 1e-4)
    estimator = NetworkEstimator("", peg, hole)
    dataset = single_contact_dataset(peg, hole, 3, np.random.default_rng(11))
    for wrench, rim in zip(dataset.wrench, dataset.translation_m, strict=True):
        found = estimator.pose_peg_hole(wrench, Pose.from_translation([0.0, 0.0, rim[2]]))
        assert np.abs(rotation_to_error_angles(found.rotation)).max() < 0.2
    with pytest.raises(NetworkUnavailable, match="train"):
        NetworkEstimator("nowhere.safetensors", peg, hole)


def test_synthetic_contacts_are_named_as_the_paper_names_them() -> None:
    """Arms and senses of the sign table: 1-2-2 is arm +y pushed to -x with Mz > 0."""
    peg = CrossPeg()
    dataset = single_contact_dataset(peg, CrossHole.around(peg, 1e-4), 200, np.random.default_rng(2))
    for wrench, state in zip(dataset.wrench, dataset.state, strict=True):
        if state == "1-2-2":
            assert wrench[0] < 0.0 < wrench[5]
    assert {str(state)[:2] for state in dataset.state} == {"1-"}
    same = single_contact_dataset(peg, CrossHole.around(peg, 1e-4), 200, np.random.default_rng(2))
    assert same.sha256() == dataset.sha256()


def test_shipped_weights_name_the_command_and_seed_that_made_them() -> None:
    record = AngleNetwork.load(SHIPPED_WEIGHTS).record
    assert record.command.startswith("crosspih train --samples 1000 --seed 1")
    assert record.seed == 1 and record.samples == 1000
    assert len(record.dataset_sha256) == 64
