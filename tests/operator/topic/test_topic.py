"""`crosspih topic`: names, fields, statistics, and the commands on a bus in memory."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from crosspih_common.bus import Bus, MemoryHub
from crosspih_common.errors import BusUnreachable, ConfigError
from crosspih_common.keys import CLOCK, EVENTS, FT_CALIBRATION, STATUS, WRENCH_RAW, topics
from crosspih_common.messages import CellClock, Event, FtCalibration, RawWrenchBatch, Severity
from services.operator.__main__ import app
from services.operator.topic import echoing, listing, measuring
from services.operator.topic.listing import rows_of
from services.operator.topic.naming import chosen_topic, sender_of, shown
from services.operator.topic.running import Arrivals, CellTimeOffset, Newest
from services.operator.topic.values import field_of, shortened

CELL = "cell1"
CALIBRATION = FtCalibration(
    calibrated=True, date="", bias=(0.0,) * 6, weight_n=4.25, centroid_m=(0.0,) * 3, gravity_base=(0.0, 0.0, -1.0),
    residual_force_n=0.0, residual_moment_nm=0.0, poses=9,
)  # fmt: skip


def test_a_topic_is_meant_by_its_path_its_whole_key_and_for_one_service_or_all() -> None:
    assert chosen_topic("ft/raw") is chosen_topic(WRENCH_RAW.key(CELL)) is WRENCH_RAW
    assert sender_of(WRENCH_RAW) == "hardware"
    assert chosen_topic("arm/follow/request").path == "arm/follow/request"
    planning = chosen_topic("service/planning/status")
    assert planning.type is STATUS.type and planning.key(CELL) == STATUS.key(CELL, "planning")
    assert sender_of(planning) == shown(planning).split("/")[1] == "planning"
    everyone = chosen_topic("service/*/status")
    assert everyone is STATUS and sender_of(everyone) is None and shown(everyone) == "service/*/status"


@pytest.mark.parametrize(
    ("written", "meant"),
    [("ft/rwa", "ft/raw"), ("wrench", "force_torque/wrench"), ("service/*/statsu", "service/*/status")],
)
def test_a_misspelt_topic_is_named_with_the_nearest(written: str, meant: str) -> None:
    with pytest.raises(ConfigError, match=f"no such topic; did you mean {meant}".replace("*", r"\*")):
        chosen_topic(written)


def test_the_list_has_every_topic_and_says_who_is_alive() -> None:
    rows = {row["key"]: row for row in rows_of({"hardware"})}
    assert rows["ft/raw"]["alive"] and rows["ft/raw"]["type"] == "RawWrenchBatch"
    assert rows["planning/phase"]["alive"] is False
    assert rows["service/*/status"]["alive"] is True
    assert all(row["alive"] is None for row in rows_of(None))
    assert len(rows_of(None, every=True)) == len(list(topics())) > len(rows)


def test_one_field_of_a_message_and_what_is_said_of_one_that_it_has_not() -> None:
    values = {"pose": {"position_m": [1.0, 2.0, 3.0]}, "text": "in"}
    assert field_of(values, "pose.position_m.1") == 2.0 and field_of(values, "pose.position_m.-1") == 3.0
    for path, said in (
        ("pose.positon_m", "did you mean position_m"),
        ("pose.position_m.3", "from 0 to 2"),
        ("text.x", "single value"),
    ):
        with pytest.raises(ConfigError, match=said):
            field_of(values, path)


def test_long_lists_are_shortened_and_short_ones_are_not() -> None:
    assert shortened({"a": [1, 2]}) == {"a": [1, 2]}
    assert shortened(list(range(30)))[-1] == "and 6 more: --full shows them"


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.integers(1, 40))
def test_the_spread_is_that_of_the_newest(values: list[float], window: int) -> None:
    newest = Newest(window)
    for value in values:
        newest.add(value)
    kept, found = values[-window:], newest.spread()
    assert found is not None and found.count == len(kept)
    assert (found.least, found.largest) == (min(kept), max(kept))
    assert found.mean == pytest.approx(sum(kept) / len(kept), abs=1e-6)
    assert found.sd**2 == pytest.approx(sum((one - found.mean) ** 2 for one in kept) / len(kept), rel=1e-6, abs=1e-6)


def test_rate_size_and_what_is_missing() -> None:
    arrivals = Arrivals(100)
    assert arrivals.rate_hz() is None and arrivals.intervals() is None
    for index, number in enumerate([4, 5, 8, 9]):  # 6 and 7 did not come
        arrivals.add(10.0 + index * 0.01, 200, number)
    assert arrivals.rate_hz() == pytest.approx(100.0) and arrivals.missing == 2
    assert arrivals.bytes_a_second() == pytest.approx(20_000.0)
    arrivals.add(10.04, 200, 0)  # the sender was started again
    assert arrivals.missing == 2


def test_the_fastest_tick_tells_the_cells_time_and_another_run_begins_anew() -> None:
    cell = CellTimeOffset()
    assert cell.offset_s is None
    cell.tick(1.00, 101.5, "a")  # .5 s on its way
    cell.tick(1.02, 101.02, "a")
    cell.tick(1.04, 101.9, "a")
    assert cell.offset_s == pytest.approx(-100.0)
    cell.tick(0.0, 200.0, "b")
    assert cell.offset_s == pytest.approx(-200.0)


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> MemoryHub:
    """A bus in memory that the commands listen on."""
    hub = MemoryHub()

    @contextmanager
    def listening() -> Iterator[Bus]:
        with Bus(hub.transport(), CELL, "operator", claim=False) as bus:
            yield bus

    for module in (echoing, listing, measuring):
        monkeypatch.setattr(module, "listening_bus", listening)
    return hub


def test_echo_prints_the_last_state_at_once_as_yaml_and_as_json(hub: MemoryHub) -> None:
    with Bus(hub.transport(), CELL, "force_torque") as sender:
        sender.publisher(FT_CALIBRATION).publish(CALIBRATION)
        said = CliRunner().invoke(app, ["topic", "echo", "force_torque/calibration", "-n", "1"])
        assert said.exit_code == 0, said.output
        assert next(yaml.safe_load_all(said.stdout))["weight_n"] == 4.25
        words = ["topic", "echo", "force_torque/calibration", "-n", "1", "--json", "--field", "weight_n"]
        assert json.loads(CliRunner().invoke(app, words).stdout) == 4.25


def test_echo_of_what_never_comes_ends_with_status_1(hub: MemoryHub) -> None:
    said = CliRunner().invoke(app, ["topic", "echo", "planning/phase", "--seconds", "0.2"])
    assert said.exit_code == 1 and "nothing came on planning/phase within 0.2 s" in said.output


@contextmanager
def _sending(hub: MemoryHub, count: int) -> Iterator[None]:
    """Sends batches from the moment on that somebody listens."""
    stop = threading.Event()
    with Bus(hub.transport(), CELL, "hardware") as sender:
        clock, raw = sender.publisher(CLOCK), sender.publisher(WRENCH_RAW)

        def send() -> None:
            for index in range(count):
                stamp_ns = 1_000_000_000 + index * 10_000_000
                clock.publish(CellClock(boot_id="a", realtime=True, stamp_ns=stamp_ns))
                raw.publish(RawWrenchBatch(period_ns=1_000_000, samples=((0.0,) * 6,), stamp_ns=stamp_ns))
                if stop.wait(0.01):
                    return

        thread = threading.Thread(target=send)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


@pytest.mark.parametrize(("command", "key"), [("hz", "rate_hz"), ("bw", "bytes_a_second"), ("delay", "delay_s")])
def test_measuring_says_so_in_words_and_as_json(hub: MemoryHub, command: str, key: str) -> None:
    with _sending(hub, 1000):
        said = CliRunner().invoke(app, ["topic", command, "ft/raw", "-n", "12", "--json"])
        assert said.exit_code == 0, said.output
        found = json.loads(said.stdout.splitlines()[-1])
        assert found["topic"] == "ft/raw" and found["messages"] >= 12 and found[key] is not None
        assert " over " in CliRunner().invoke(app, ["topic", command, "ft/raw", "-n", "12"]).stdout


def test_list_without_a_router_still_lists(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody() -> AbstractContextManager[Bus]:
        raise BusUnreachable("no router at tcp/127.0.0.1:9")

    monkeypatch.setattr(listing, "listening_bus", nobody)
    said = CliRunner().invoke(app, ["topic", "list", "--json"])
    assert said.exit_code == 0 and len(json.loads(said.stdout)) == len(rows_of(None))
    assert "no router at" in said.stderr


def test_of_all_services_the_one_that_is_named_is_shown(hub: MemoryHub) -> None:
    with Bus(hub.transport(), CELL, "vision") as vision, Bus(hub.transport(), CELL, "planning") as planning:
        for bus in (vision, planning):
            bus.publisher(EVENTS).publish(Event(service=bus.service, severity=Severity.INFO, code="up", text="is up"))
        said = CliRunner().invoke(app, ["topic", "echo", "service/planning/event", "-n", "1", "--field", "service"])
        assert said.stdout.splitlines()[0] == "planning", said.output
