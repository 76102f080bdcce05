"""What a soak takes of processes, and how it tells growth from noise."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from services.operator.bench.cells.processes import ProcessResources, held_by
from services.operator.bench.reliability.soak.measuring import Figures, complaints, grown, size_mb
from services.operator.bench.reliability.soak.trend import growth

MINUTE_S = 60.0


def figures(number: int, memory_mb: float, **more: object) -> Figures:
    taken = {
        "at_s": number * MINUTE_S, "seed": number, "inserted": True, "ended_as": "inserted", "wall_s": 4.0,
        "latency_ms": (1.0, 2.0),
        "services": {"vision": ProcessResources(memory_mb=memory_mb, descriptors=30, threads=9)},
        "restarts": {"vision": 0}, "dropped": {"vision": 0}, "rejected": {"vision": 0}, "recorded_mb": 3.0,
        "kept_mb": 0.5, "missing": (),
    }  # fmt: skip
    return Figures.model_validate({**taken, **more})


@given(st.floats(-2.0, 2.0), st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_a_slope_is_found_whatever_the_outliers(slope: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    at_s = np.arange(60.0)
    values = 100.0 + slope * at_s + rng.normal(size=60) * 0.1
    values[rng.choice(60, 6, replace=False)] += 500.0
    found = growth(at_s.tolist(), values.tolist())
    assert found is not None
    span_s = at_s[-1] - at_s[12]  # after the warm-up
    assert abs(found.grown - slope * span_s) < 1.0 and found.low <= found.grown <= found.high


def test_too_few_figures_say_nothing() -> None:
    assert growth([0.0, 1.0, 2.0], [1.0, 2.0, 3.0]) is None
    assert growth([1.0] * 20, [2.0] * 20) is None


def test_a_leak_is_named_and_noise_is_not() -> None:
    rng = np.random.default_rng(1)
    noise = [figures(number, 200.0 + float(rng.normal())) for number in range(30)]
    assert all(row.flat for row in grown(noise)) and complaints(noise, grown(noise)) == []
    leak = [figures(number, 200.0 + 0.5 * number + float(rng.normal())) for number in range(30)]
    said = complaints(leak, grown(leak))
    assert len(said) == 1 and said[0].startswith("vision: memory grows: +")


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_what_an_allocator_keeps_is_no_leak_and_a_leak_under_it_is_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    needs_mb = rng.exponential(5.0, 200)  # each assembly's own, of which the allocator keeps the largest
    needs_mb[:100] = rng.permutation(np.append(needs_mb[:99], needs_mb.max()))
    kept = [figures(number, 150.0 + float(needs_mb[: number + 1].max())) for number in range(200)]
    assert complaints(kept, grown(kept)) == []
    leak = [figures(number, 150.0 + float(needs_mb[: number + 1].max()) + 0.03 * number) for number in range(200)]
    assert [one.split(":")[0] for one in complaints(leak, grown(leak))] == ["vision"]  # 6 MB in all


def test_whatever_was_lost_is_named() -> None:
    last = figures(
        7, 200.0, inserted=False, ended_as="service_lost", dropped={"recorder": 3}, rejected={"vision": 2},
        restarts={"hardware": 1}, missing=("12 samples never came",),
    )  # fmt: skip
    assert complaints([last], []) == [
        "seed 7: service_lost", "seed 7: 12 samples never came", "recorder dropped 3 samples",
        "vision rejected 2 samples", "hardware was started again 1 times",
    ]  # fmt: skip


def test_the_kernel_tells_what_a_process_holds(tmp_path: Path) -> None:
    before = held_by(os.getpid())
    files = [(tmp_path / str(number)).open("w") for number in range(5)]
    try:
        after = held_by(os.getpid())
    finally:
        for file in files:
            file.close()
    assert before is not None and after is not None
    assert after.descriptors - before.descriptors == 5 and after.memory_mb > 1.0 and after.threads >= 1
    assert held_by(2**22 + 1) is None  # above the kernel's largest number of a process


def test_the_size_of_a_folder_is_that_of_its_files(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "a").write_bytes(b"x" * 1_000_000)
    (tmp_path / "below" / "b").write_bytes(b"x" * 500_000)
    assert size_mb(tmp_path) == 1.5
