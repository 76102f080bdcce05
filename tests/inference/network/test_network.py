"""The paper's network: its training reaches the printed goal, keeps to its rules, and its files keep what they got."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("torch", reason="set-up left torch out")

import torch

from crosspih_common.geometry import Pose, rotation_to_error_angles
from crosspih_common.shapes import CrossPeg
from services.inference.network.paper.dataset import ContactDataset, split_by_pose
from services.inference.network.paper.estimator import NetworkEstimator, NetworkUnavailable
from services.inference.network.paper.evaluation import judge, leave_one_out
from services.inference.network.paper.floor import floor_rms_rad, nearest_neighbours
from services.inference.network.paper.levenberg import LevenbergMarquardt
from services.inference.network.paper.model import AngleNetwork
from services.inference.network.paper.paper_rows import paper_rows
from services.inference.network.paper.synthesis import single_contact_dataset
from services.inference.network.paper.traingdx import TrainGdx
from services.inference.network.paper.training import train
from services.inference.network.settings import PAPER_WEIGHTS, Optimiser, TrainingSettings
from tests.paper_tables import TABLE_6, TABLE_7_RAD, paper_dataset

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)


def contacts(count: int, seed: int = 0) -> ContactDataset:
    return single_contact_dataset(PEG, HOLE, count, np.random.default_rng(seed))


def test_the_product_has_the_rows_that_the_tests_have() -> None:
    assert paper_rows().sha256() == paper_dataset().sha256()


def test_ten_rows_reach_the_goal_and_stay_within_a_degree() -> None:
    network, curves = train(paper_rows(), seed=0, command="test")
    assert network.record.reached_goal and network.record.mse_scaled <= 1e-3 and network.record.epochs < 1000
    assert np.degrees(np.abs(network.predict(TABLE_6) - TABLE_7_RAD)).max() < 1.0
    assert curves.stopped == "goal" and curves.training[-1] == network.record.mse_scaled


def test_a_row_that_was_left_out_is_not_within_a_degree() -> None:
    predicted, means = leave_one_out(paper_rows(), [0], TrainingSettings(epochs=250))
    rms = np.degrees(np.sqrt(np.mean((predicted[0] - TABLE_7_RAD) ** 2, axis=0)))
    assert rms[1] > 2.0 and rms.max() < 4.0
    assert means[0] == pytest.approx(TABLE_7_RAD[1:].mean(axis=0))


@pytest.mark.parametrize("optimiser", list(Optimiser))
def test_same_seed_same_network_and_the_file_keeps_it(optimiser: Optimiser, tmp_path: Path) -> None:
    split = split_by_pose(contacts(80), 1)
    settings = TrainingSettings(optimiser, hidden=12, epochs=15, goal=0.0)
    (first, curves), (second, _) = (train(split.training, 5, "test", split.validation, settings) for _ in range(2))
    assert np.array_equal(first.predict(TABLE_6), second.predict(TABLE_6))
    assert min(curves.training) < 0.8 * curves.training[0]
    assert curves.validation[curves.best] == min(curves.validation) == first.record.validation_mse_scaled
    first.save(tmp_path / "network.safetensors")
    loaded = AngleNetwork.load(tmp_path / "network.safetensors")
    assert loaded.record == first.record and loaded.record.optimiser == optimiser.value
    assert loaded.predict(TABLE_6) == pytest.approx(first.predict(TABLE_6), abs=1e-12)


def test_the_scaling_is_the_trainings_own() -> None:
    split = split_by_pose(contacts(60), 3)
    wild = dataclasses.replace(split.validation, wrench=split.validation.wrench * 100.0)
    network, _ = train(split.training, 0, "test", wild, TrainingSettings(epochs=1))
    assert network.low_in == pytest.approx(split.training.wrench.min(axis=0))
    assert network.low_out + network.span_out == pytest.approx(split.training.angles_rad.max(axis=0))


def test_it_stops_early_and_keeps_the_best_weights() -> None:
    """With the validation's angles turned round, every step towards the training's is one away from them."""
    split = split_by_pose(contacts(60), 3)
    against = dataclasses.replace(split.training, angles_rad=-split.training.angles_rad)
    settings = TrainingSettings(Optimiser.LM, hidden=20, epochs=100, goal=0.0, patience=4)
    network, curves = train(split.training, 0, "test", against, settings)
    assert curves.stopped == "validation" and len(curves.training) - 1 == curves.best + 4
    scaled = network.scaled(against.wrench, against.angles_rad)
    reached = float(torch.nn.functional.mse_loss(network.layers(scaled[0]), scaled[1]).detach())
    assert reached == pytest.approx(min(curves.validation), rel=1e-9)


@given(st.integers(10, 60), st.integers(1, 4), st.integers(0, 1000))
def test_no_pose_is_in_two_splits(poses: int, repeats: int, seed: int) -> None:
    pose = np.repeat(np.arange(poses), repeats)
    n = len(pose)
    rows = np.arange(n, dtype=float)[:, None]
    data = ContactDataset(np.tile(rows, 6), np.tile(rows, 3), np.tile(rows, 3), np.full(n, "1-1-1"), pose)
    split = split_by_pose(data, seed)
    parts = [part.pose for part in (split.training, split.validation, split.test)]
    assert sorted(np.concatenate([part for part in parts if part is not None]).tolist()) == pose.tolist()
    sets = [set(part.tolist()) for part in parts if part is not None]
    assert not sets[0] & sets[1] and not sets[1] & sets[2] and not sets[0] & sets[2]
    assert all(np.array_equal(part.wrench[:, 0], rows[np.isin(rows[:, 0], part.wrench[:, 0]), 0])
               for part in (split.training, split.test))  # fmt: skip


def test_two_poses_cannot_be_split() -> None:
    with pytest.raises(ValueError, match="too few"):
        split_by_pose(contacts(2), 0)


def test_levenberg_marquardt_solves_the_normal_equations() -> None:
    """Its Jacobian is autograd's: the step of a tiny network is the dense solution's."""
    torch.manual_seed(1)
    layers = torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.Sigmoid(), torch.nn.Linear(3, 2)).double()
    inputs, targets = torch.rand(7, 2, dtype=torch.float64), torch.rand(7, 2, dtype=torch.float64)
    names = [name for name, _ in layers.named_parameters()]
    start = torch.nn.utils.parameters_to_vector(layers.parameters()).detach().clone()

    def errors(vector: torch.Tensor) -> torch.Tensor:
        values, place = {}, 0
        for name, parameter in layers.named_parameters():
            values[name] = vector[place : place + parameter.numel()].reshape(parameter.shape)
            place += parameter.numel()
        said: torch.Tensor = torch.func.functional_call(layers, values, (inputs,))
        return (said - targets).reshape(-1)

    jacobian = torch.autograd.functional.jacobian(errors, start)  # type: ignore[no-untyped-call]
    step = torch.linalg.solve(
        jacobian.T @ jacobian + 1e-3 * torch.eye(len(start), dtype=torch.float64), -jacobian.T @ errors(start)
    )
    reached, goes_on = LevenbergMarquardt(layers).step(inputs, targets)
    assert goes_on and len(names) == 4
    assert torch.nn.utils.parameters_to_vector(layers.parameters()).detach().numpy() == pytest.approx(
        (start + step).numpy(), abs=1e-9
    )
    assert reached == pytest.approx(float(torch.mean(errors(start + step) ** 2)))


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


def test_the_floor_of_a_known_relation() -> None:
    """Angles that are a function of the wrench but for noise of sd 0.02: the floor is the noise."""
    rng = np.random.default_rng(4)
    wrench = np.zeros((6000, 6))
    wrench[:, :2] = rng.uniform(-2.0, 2.0, (6000, 2))
    angles = np.column_stack([wrench[:, 0] * 0.01, wrench[:, 1] * 0.01, np.zeros(6000)])
    angles = angles + rng.normal(size=angles.shape) * 0.02
    rms = floor_rms_rad(wrench[500:], angles[500:], wrench[:500], angles[:500])
    assert rms == pytest.approx([0.02] * 3, rel=0.1)
    with pytest.raises(ValueError, match="at least one"):
        nearest_neighbours(wrench[:0], angles[:0], wrench)


def test_a_judgement_counts_what_it_says() -> None:
    split = split_by_pose(contacts(400), 0)
    settings = TrainingSettings(Optimiser.LM, hidden=10, epochs=20)
    network, _ = train(split.training, 0, "test", split.validation, settings)
    parts = judge(network, split)
    error = np.degrees(network.predict(split.test.wrench) - split.test.angles_rad)
    assert parts["test"]["network"]["rms_deg"] == pytest.approx(np.sqrt(np.mean(error**2, axis=0)), abs=1e-3)
    assert parts["test"]["samples"] == len(split.test) == len(parts["test"]["true_deg"])
    # alpha is in the wrench; beta and gamma hardly are
    assert parts["test"]["network"]["rms_deg"][0] < 0.7 * parts["test"]["mean"]["rms_deg"][0]


def test_dataset_names_a_wrong_shape() -> None:
    with pytest.raises(ValueError, match="state"):
        ContactDataset(TABLE_6, TABLE_7_RAD, np.zeros((10, 3)), np.array(["1-2-2"]))


def test_shipped_weights_answer_with_a_pose_that_explains_the_wrench() -> None:
    estimator = NetworkEstimator("", PEG, HOLE)
    dataset = contacts(3, 11)
    for wrench, rim in zip(dataset.wrench, dataset.translation_m, strict=True):
        found = estimator.pose_peg_hole(wrench, Pose.from_translation([0.0, 0.0, rim[2]]))
        assert np.abs(rotation_to_error_angles(found.rotation)).max() < 0.2
    with pytest.raises(NetworkUnavailable, match="train"):
        NetworkEstimator("nowhere.safetensors", PEG, HOLE)


def test_synthetic_contacts_are_named_as_the_paper_names_them() -> None:
    """Arms and senses of the sign table: 1-2-2 is arm +y pushed to -x with Mz > 0."""
    dataset = contacts(200, 2)
    for wrench, state in zip(dataset.wrench, dataset.state, strict=True):
        if state == "1-2-2":
            assert wrench[0] < 0.0 < wrench[5]
    assert {str(state)[:2] for state in dataset.state} == {"1-"}
    assert contacts(200, 2).sha256() == dataset.sha256()


def test_shipped_weights_name_the_command_and_seed_that_made_them() -> None:
    record = AngleNetwork.load(PAPER_WEIGHTS).record
    assert record.command.startswith("crosspih train ") and f"--seed {record.seed}" in record.command
    assert record.samples >= 800 and len(record.dataset_sha256) == 64
