"""The benches of speed: what they make of what they measured, and that each measures. No time is judged here."""

from __future__ import annotations

import math
import sys

import pytest

from crosspih_common.errors import CrosspihError
from services.hardware.drivers.simulated.engines.registry import installed_engines
from services.hardware.rate import measure_engine
from services.inference.rate import measured as answers_measured
from services.operator.bench.speed import startup
from services.operator.bench.speed.bus.command import measured
from services.operator.bench.speed.bus.figures import BusRound, figures_of, turn_of
from services.operator.bench.speed.bus.ways import PAYLOAD_BYTES, RAW, installed_ways, message, number_of, plain
from services.operator.bench.speed.inference import InferenceResult
from services.operator.bench.speed.recorder import result_of as recorder_result
from services.operator.bench.speed.where_time_goes import TrialTime, cpu_of
from services.operator.bench.speed.where_time_goes import result_of as trials_result
from services.recorder.rate import measure, paced


def test_a_turn_joins_what_was_sent_to_what_was_heard() -> None:
    turn = turn_of({1: 1000, 2: 3000}, {3: 10_000, 4: 20_000}, {1: 3000, 3: 40_000}, (0.5, 0.25))
    assert turn.delays_us == (2.0,)
    assert (turn.burst_sent, turn.burst_heard) == (2, 1)
    assert turn.burst_s == pytest.approx(30e-6)


def test_ratios_are_against_the_other_of_the_same_round() -> None:
    def turn(delay_us: float, seconds: float, heard: int = 10) -> BusRound:
        return BusRound(
            delays_us=(delay_us,), burst_sent=10, burst_heard=heard, burst_s=seconds, send_cpu_s=1e-4, hear_cpu_s=2e-4
        )

    rounds = [
        {"bare": turn(100.0, 1.0), "dumped": turn(110.0, 2.0), "ours": turn(150.0, 4.0)},
        {"bare": turn(200.0, 2.0), "dumped": turn(220.0, 4.0), "ours": turn(300.0, 8.0, heard=5)},
    ]
    bare, _, ours = figures_of(rounds, "bare", "dumped")
    assert bare.p50_ratio == 1.0 and bare.throughput_ratio == 1.0 and bare.lost == 0.0
    assert ours.p50_ratio == 1.5  # in both rounds, though the second was twice as slow for all
    assert ours.throughput_ratio == pytest.approx((0.25 + 0.125) / 2)
    assert ours.throughput_of_pydantic == pytest.approx((0.5 + 0.25) / 2)
    assert ours.lost == 0.25
    assert (ours.send_cpu_us, ours.hear_cpu_us) == pytest.approx((10.0, 30.0))


def test_every_way_sends_as_many_bytes_and_its_number() -> None:
    assert len(plain(77)) == PAYLOAD_BYTES and number_of(plain(77)) == 77
    assert message(77).stamp_ns == 77 and message(77) != message(78)


def test_the_bus_is_measured_between_two_processes() -> None:
    result = measured(rounds=1, steady=10, burst=20, rate_hz=1000.0)
    assert [row.way for row in result.ways] == list(installed_ways())
    assert all(row.lost == 0.0 and math.isfinite(row.p50_us) for row in result.ways[:4])
    assert result.ways[0].way == RAW and result.ways[0].p50_ratio == 1.0


def test_the_recorder_is_measured_in_turn_and_loses_nothing() -> None:
    rates = measure(300, rounds=2)
    assert all(len(each) == 2 and min(each) > 0.0 for each in rates.values())
    beside = paced(200, rate_hz=1000.0)
    assert beside["lost"] == 0 and beside["seconds"] >= 0.19
    result = recorder_result(
        {"bare": [2.0, 4.0], "ours": [1.0, 3.0], "shown": [0.5, 1.0], "bare_cpu": [8.0], "ours_cpu": [2.0]}, [beside], 9
    )
    assert (result.ratio, result.cpu_ratio, result.shown_ratio) == (0.625, 0.25, 0.25)
    assert (result.cells, result.sent, result.lost) == (1, 200, 0)


def test_the_cells_loop_is_measured_at_rest_and_in_a_move() -> None:
    rates = measure_engine(installed_engines()[0], 100)
    assert set(rates) == {"cell", "move", "engine"} and min(rates.values()) > 0.0


def test_a_process_is_timed_and_one_that_lacks_a_module_is_named() -> None:
    wall_s, cpu_s = startup.timed([sys.executable, "-c", "sum(range(100000))"])
    assert wall_s > 0.0 and cpu_s > 0.0
    with pytest.raises(CrosspihError, match="no_such_service"):
        startup.timed(startup.importing("no_such_service"))


def test_cpu_time_is_read_past_any_name() -> None:
    assert cpu_of("17 (a (b) c) S 1 1 1 0 -1 4194304 9 0 0 0 250 150 0 0 20 0 1", 100.0) == 4.0


def test_what_nobody_computes_in_is_waiting() -> None:
    def account(wall_s: float, hardware_s: float) -> TrialTime:
        return TrialTime(
            seed=1, inserted=True, wall_s=wall_s, motion_s=6.0, rendering_s=0.5,
            cpu_s={"hardware": hardware_s, "vision": 0.25, "operator": 0.25},
        )  # fmt: skip

    result = trials_result([account(3.0, 1.5), account(5.0, 2.5), account(4.0, 2.0)])
    assert (result.trials, result.inserted, result.wall_s) == (3, 3, 4.0)
    assert result.parts_s["physics and control (hardware)"] == 1.5
    assert result.parts_s["vision"] == 0.25
    assert result.waiting_s == 1.5


def test_an_answer_is_measured_beside_the_first_contacts_that_it_asked_for() -> None:
    costs = InferenceResult.model_validate({"costs": answers_measured(rounds=1, seed=1, most_touches=1)}).costs
    one = costs["estimate of 1 touch"]
    assert one.ratio > 1.0 and int(one.beside.split()[1]) > 240  # at least one first contact a sample of the prior
    assert {"most informative touch", "estimate of 1 touch, as a command"} <= set(costs)
