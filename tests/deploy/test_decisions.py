"""The launcher's pure decisions: restarts, health, conditions; and what it does with bytes: lines and log files."""

import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.errors import CONFIG_STATUS
from deploy.launcher import StartError, logfile
from deploy.launcher.conditions import DependencyVerdict, ServicePhase, ServiceStanding, StartCondition, judge
from deploy.launcher.display import stopped_lines
from deploy.launcher.health import Health, HealthState, after_check, after_notification, after_silence
from deploy.launcher.logfile import LineSplitter, LogLine, LogTail, LogWriter, merged
from deploy.launcher.port import require_free_port
from deploy.launcher.restart import LONGEST_DELAY_S, STEADY_AFTER_S, RestartDecision, RestartPolicy, decide
from deploy.launcher.state import Stopped

STARTING = HealthState(Health.STARTING)


@pytest.mark.parametrize(
    ("policy", "exit_code", "restarted"),
    [
        ("no", 1, False),
        ("always", 0, True),
        ("unless-stopped", 0, True),
        ("on-failure", 0, False),
        ("on-failure", 1, True),
        ("on-failure", -9, True),
        ("always", CONFIG_STATUS, False),
        ("unless-stopped", CONFIG_STATUS, False),
    ],
)
def test_policy(policy: str, exit_code: int, restarted: bool) -> None:
    assert (decide(RestartPolicy.parse(policy), exit_code, 0.0, 0) is not None) == restarted


def test_back_off_doubles_and_a_steady_run_resets_it() -> None:
    policy, attempt, delays_s = RestartPolicy.parse("always"), 0, []
    for _ in range(9):
        decision = decide(policy, 1, 0.0, attempt)
        assert decision is not None
        attempt = decision.attempt
        delays_s.append(decision.delay_s)
    assert delays_s == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 10.0, 10.0])
    assert decide(policy, 1, STEADY_AFTER_S, attempt) == RestartDecision(0.1, 1)


def test_retries_are_counted_in_a_row() -> None:
    policy = RestartPolicy.parse("on-failure:2")
    assert decide(policy, 1, 0.0, 1) == RestartDecision(0.2, 2)
    assert decide(policy, 1, 0.0, 2) is None
    assert decide(policy, 1, STEADY_AFTER_S, 2) == RestartDecision(0.1, 1)


@given(st.integers(0, 10**6), st.floats(0.0, 1e9))
def test_delay_is_bounded(attempt: int, ran_s: float) -> None:
    decision = decide(RestartPolicy.parse("always"), 1, ran_s, attempt)
    assert decision is not None
    assert 0.0 < decision.delay_s <= LONGEST_DELAY_S


def test_checks_fail_in_a_row_before_they_count() -> None:
    state = after_check(STARTING, True, 2, False)
    assert state.health is Health.HEALTHY
    state = after_check(state, False, 2, False)
    assert state.health is Health.HEALTHY
    assert after_check(after_check(state, True, 2, False), False, 2, False).health is Health.HEALTHY
    state = after_check(state, False, 2, False)
    assert state.health is Health.UNHEALTHY
    assert after_check(state, True, 2, False) == HealthState(Health.HEALTHY)


def test_failures_in_the_start_period_do_not_count() -> None:
    assert after_check(STARTING, False, 1, True) == STARTING
    assert after_check(STARTING, False, 1, False).health is Health.UNHEALTHY
    # Once it was healthy the start period is over.
    assert after_check(HealthState(Health.HEALTHY), False, 1, True).health is Health.UNHEALTHY


def test_notifications() -> None:
    state = after_notification(STARTING, b"WATCHDOG=1\nSTATUS=loading weights", 1.0)
    assert (state.health, state.status, state.alive_at_s) == (Health.STARTING, "loading weights", 1.0)
    state = after_notification(state, b"READY=1", 2.0)
    assert (state.health, state.status, state.alive_at_s) == (Health.HEALTHY, "loading weights", 2.0)
    assert after_silence(state, 1.0, 3.0) == state
    hung = after_silence(state, 1.0, 3.1)
    assert hung.health is Health.UNHEALTHY
    assert after_notification(hung, b"STATUS=x", 3.2).health is Health.UNHEALTHY
    assert after_notification(hung, b"WATCHDOG=1", 3.2).health is Health.HEALTHY


@given(st.binary())
def test_no_datagram_breaks_it(message: bytes) -> None:
    after_notification(STARTING, message, 0.0)


def test_starting_service_is_not_hung() -> None:
    assert after_silence(STARTING, 1.0, 1e6) == STARTING


@pytest.mark.parametrize(
    ("standing", "started", "healthy", "completed"),
    [
        (
            ServiceStanding(ServicePhase.WAITING),
            DependencyVerdict.PENDING,
            DependencyVerdict.PENDING,
            DependencyVerdict.PENDING,
        ),
        (
            ServiceStanding(ServicePhase.RUNNING, STARTING),
            DependencyVerdict.MET,
            DependencyVerdict.PENDING,
            DependencyVerdict.PENDING,
        ),
        (
            ServiceStanding(ServicePhase.RUNNING, HealthState(Health.HEALTHY)),
            DependencyVerdict.MET,
            DependencyVerdict.MET,
            DependencyVerdict.PENDING,
        ),
        (
            ServiceStanding(ServicePhase.RUNNING, HealthState(Health.UNHEALTHY)),
            DependencyVerdict.MET,
            DependencyVerdict.PENDING,
            DependencyVerdict.PENDING,
        ),
        (
            ServiceStanding(ServicePhase.RESTARTING, exit_code=1),
            DependencyVerdict.MET,
            DependencyVerdict.PENDING,
            DependencyVerdict.PENDING,
        ),
        (
            ServiceStanding(ServicePhase.EXITED, exit_code=0),
            DependencyVerdict.MET,
            DependencyVerdict.NEVER,
            DependencyVerdict.MET,
        ),
        (
            ServiceStanding(ServicePhase.EXITED, exit_code=1),
            DependencyVerdict.MET,
            DependencyVerdict.NEVER,
            DependencyVerdict.NEVER,
        ),
        (
            ServiceStanding(ServicePhase.BLOCKED),
            DependencyVerdict.NEVER,
            DependencyVerdict.NEVER,
            DependencyVerdict.NEVER,
        ),
        (
            ServiceStanding(ServicePhase.STOPPED),
            DependencyVerdict.NEVER,
            DependencyVerdict.NEVER,
            DependencyVerdict.NEVER,
        ),
    ],
)
def test_conditions(
    standing: ServiceStanding, started: DependencyVerdict, healthy: DependencyVerdict, completed: DependencyVerdict
) -> None:
    conditions = (StartCondition.STARTED, StartCondition.HEALTHY, StartCondition.COMPLETED)
    assert tuple(judge(condition, standing) for condition in conditions) == (started, healthy, completed)


@given(st.text(st.characters(codec="utf-8", exclude_characters="\r")), st.integers(1, 7))
def test_lines_do_not_depend_on_how_they_arrive(text: str, size: int) -> None:
    data, splitter, lines = text.encode(), LineSplitter(), []
    for start in range(0, len(data), size):
        lines += splitter.feed(data[start : start + size])
    assert "\n".join(lines + splitter.finish()) == text.removesuffix("\n")


def test_endless_line_is_cut() -> None:
    splitter = LineSplitter()
    lines = splitter.feed(b"x" * (2 * logfile.LONGEST_LINE_B + 1))
    assert [len(line) for line in [*lines, *splitter.finish()]] == [logfile.LONGEST_LINE_B] * 2 + [1]


def test_logs_are_read_back_in_order_while_they_grow(tmp_path: Path) -> None:
    writers = {name: LogWriter(tmp_path / f"{name}.log") for name in ("a", "b")}
    tails = [LogTail(tmp_path / f"{name}.log") for name in writers]
    written = [LogLine("b", "2026-01-01T00:00:00.1Z", "one"), LogLine("a", "2026-01-01T00:00:00.2Z", "two  spaces ")]
    for line in written:
        writers[line.service].write(line)
    assert list(merged(tails)) == written
    assert list(merged(tails)) == []
    last = LogLine("b", "2026-01-01T00:00:00.3Z", "")
    writers["b"].write(last)
    assert list(merged(tails)) == [last]
    for writer in writers.values():
        writer.close()


def test_full_log_is_set_aside_and_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logfile, "LARGEST_FILE_B", 60)
    path = tmp_path / "a.log"
    writer, tail = LogWriter(path), LogTail(path)
    lines = [LogLine("a", f"2026-01-01T00:00:00.{index}Z", "x" * 10) for index in range(3)]
    seen: list[LogLine] = []
    for line in lines:
        writer.write(line)
        seen += tail.read()
    writer.close()
    # The second line filled the file, which was set aside before the reader looked again.
    assert seen == lines
    assert path.with_name("a.log.1").read_text().count("\n") == 2


def test_what_was_stopped_is_told_service_by_service() -> None:
    stopped = [Stopped(service="planning", killed=False, seconds=0.31), Stopped(service="hw", killed=True, seconds=2.3)]
    assert stopped_lines(stopped, 2.44) == [
        "planning  ended after 0.31 s",
        "hw        killed: it did not end after 2.30 s",
        "the stack is down after 2.4 s: 1 ended, 1 killed",
    ]
    assert "was killed" in stopped_lines([], 5.0)[0]


def test_a_port_that_is_taken_is_said_with_another_one() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(
            StartError, match=rf"tcp/127.0.0.1:{port} is in use.*CROSSPIH_ENDPOINT=tcp/127.0.0.1:{port + 1}"
        ):
            require_free_port(f"tcp/127.0.0.1:{port}")
    require_free_port(f"tcp/127.0.0.1:{port}")
    require_free_port("tcp/192.0.2.1:7447")  # another machine's
