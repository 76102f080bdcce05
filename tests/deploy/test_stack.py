"""The launcher with real processes: started, killed, hung, stopped and abandoned."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from crosspih_common.errors import CONFIG_STATUS
from deploy.launcher import AlreadyUpError, NotUpError, StartError, is_up, stop_stack
from deploy.launcher.conditions import ServicePhase
from deploy.launcher.health import Health
from tests.deploy.harness import NOTIFY, SERVE, Stacks, is_alive, wait_until

PYTHON = [sys.executable, "-S", "-c"]
# Prints the pid of a child of its own, and neither of them ends when asked to.
STUBBORN = [
    *PYTHON,
    "import os,signal;signal.signal(signal.SIGTERM,signal.SIG_IGN);child=os.fork();"
    "child and print(child,flush=True);signal.pause()",
]
READY = [*PYTHON, NOTIFY + "import signal;n.send(b'READY=1\\nSTATUS=at work');signal.pause()"]
ALIVE = [*PYTHON, NOTIFY + "import time;n.send(b'READY=1')\nwhile True: n.send(b'WATCHDOG=1');time.sleep(0.05)"]


def _pids(stacks: Stacks, *services: str) -> list[int]:
    pids = [stacks.row(service).pid for service in services]
    assert None not in pids
    return [pid for pid in pids if pid is not None]


def test_up_ps_logs_and_down_from_other_shells(stacks: Stacks) -> None:
    compose = stacks.compose(
        {
            "first": {"command": READY, "x-notify": True},
            "second": {"command": SERVE, "depends_on": {"first": {"condition": "service_healthy"}}},
        }
    )
    up = stacks.cli("up", "--detach", "--wait", "--file", str(compose))
    assert up.returncode == 0, up.stderr
    assert up.stdout.index("first: healthy") < up.stdout.index("second: running")

    shown = json.loads(stacks.cli("ps", "--json").stdout)
    assert shown["up"] is True
    rows = {row["service"]: row for row in shown["services"]}
    assert (rows["first"]["phase"], rows["first"]["health"], rows["first"]["note"]) == ("running", "healthy", "at work")
    assert (rows["second"]["phase"], rows["second"]["health"]) == ("running", "none")
    table = stacks.cli("ps").stdout
    assert "first" in table and "healthy" in table

    wait_until(lambda: "serving" in stacks.log("second"), "second serves")
    assert "second | serving" in stacks.cli("logs").stdout
    assert "first" not in stacks.cli("logs", "second").stdout
    refused = stacks.cli("logs", "third")
    assert refused.returncode == 1 and refused.stderr.count("\n") == 1 and "third" in refused.stderr

    down = stacks.cli("down")
    assert down.returncode == 0 and "second  ended after" in down.stdout and "the stack is down" in down.stdout
    assert not any(is_alive(rows[name]["pid"]) for name in rows)
    wait_until(lambda: not is_alive(shown["supervisor_pid"]), "the supervisor ends just after it let go of its lock")
    after = stacks.cli("ps")
    assert after.returncode == 1 and "not up" in after.stderr
    assert stacks.cli("down").returncode == 1


def test_killed_service_is_restarted_and_others_go_on(stacks: Stacks) -> None:
    stacks.start({"killed": {"command": READY, "x-notify": True, "restart": "on-failure"}, "other": {"command": SERVE}})
    killed, other = _pids(stacks, "killed", "other")
    os.kill(killed, signal.SIGKILL)
    wait_until(lambda: stacks.row("killed").restarts == 1, "the restart")
    wait_until(lambda: stacks.row("killed").health is Health.HEALTHY, "healthy again")
    assert stacks.row("killed").exit_code == -signal.SIGKILL
    assert _pids(stacks, "killed") != [killed]
    assert _pids(stacks, "other") == [other]


def test_gives_up_after_the_retries_and_ends_when_nothing_is_left(stacks: Stacks) -> None:
    request = stacks.request({"fails": {"command": [*PYTHON, "raise SystemExit(3)"], "restart": "on-failure:2"}})
    process = stacks.cli_in_foreground("up", "--file", str(request.compose_file), "--project", "test")
    output, _ = process.communicate(timeout=30.0)
    assert process.returncode == 1
    assert output.count("starts again") == 2 and "ended (exit 3)\n" in output
    row = stacks.row("fails")
    assert (row.phase, row.exit_code, row.restarts) == (ServicePhase.EXITED, 3, 2)


def test_interrupt_stops_all_and_leaves_no_process(stacks: Stacks) -> None:
    compose = stacks.compose(
        {
            "base": {"command": SERVE},
            "stubborn": {"command": STUBBORN, "depends_on": ["base"]},
        }
    )
    process = stacks.cli_in_foreground("up", "--file", str(compose), "--project", "test")
    wait_until(lambda: is_up("test", stacks.run_root), "up")
    wait_until(lambda: (stacks.directory().read() or None) is not None, "a state")
    wait_until(lambda: stacks.row("stubborn").pid is not None, "all run")
    pids = [*_pids(stacks, "base", "stubborn"), stacks.pid_written_by("stubborn")]
    os.killpg(process.pid, signal.SIGINT)
    output, _ = process.communicate(timeout=30.0)
    assert process.returncode == 0
    assert "base     | serving" in output and "did not end in time; killed" in output
    assert not any(is_alive(pid) for pid in pids)
    assert not is_up("test", stacks.run_root)


def test_dependants_stop_before_what_they_depend_on(stacks: Stacks) -> None:
    says = "import signal,sys;signal.signal(signal.SIGTERM,lambda *_:sys.exit(print('bye')));print('on');signal.pause()"
    stacks.start({"base": {"command": [*PYTHON, says]}, "user": {"command": [*PYTHON, says], "depends_on": ["base"]}})
    wait_until(lambda: all("on" in stacks.log(name) for name in ("base", "user")), "both run")
    stop_stack("test", stacks.run_root)
    tails = stacks.directory().tails()
    told = {name: next(line.time for line in tail.read() if line.text == "bye") for name, tail in tails.items()}
    assert told["user"] < told["base"]


def test_killed_supervisor_leaves_no_orphan_and_stale_state_is_cleaned(stacks: Stacks) -> None:
    services: dict[str, object] = {"polite": {"command": SERVE}, "stubborn": {"command": STUBBORN}}
    state = stacks.start(services)
    pids = [*_pids(stacks, "polite", "stubborn"), stacks.pid_written_by("stubborn")]
    os.kill(state.supervisor_pid, signal.SIGKILL)
    wait_until(lambda: not any(is_alive(pid) for pid in pids), "no orphans")
    stale = stacks.cli("ps", "--project", "test")
    assert stale.returncode == 1 and f"(pid {state.supervisor_pid}) died" in stale.stderr
    assert stacks.directory().read() is None
    with pytest.raises(NotUpError):
        stop_stack("test", stacks.run_root)
    assert stacks.start(services).supervisor_pid != state.supervisor_pid


def test_hung_service_becomes_unhealthy_and_recovers(stacks: Stacks) -> None:
    stacks.start({"hangs": {"command": ALIVE, "x-notify": True, "x-watchdog_s": 0.5}})
    (pid,) = _pids(stacks, "hangs")
    os.kill(pid, signal.SIGSTOP)
    wait_until(lambda: stacks.row("hangs").health is Health.UNHEALTHY, "unhealthy")
    assert stacks.row("hangs").phase is ServicePhase.RUNNING
    os.kill(pid, signal.SIGCONT)
    wait_until(lambda: stacks.row("hangs").health is Health.HEALTHY, "healthy again")
    assert _pids(stacks, "hangs") == [pid]


def test_healthcheck_command_decides(stacks: Stacks, tmp_path: Path) -> None:
    sign = tmp_path / "sign"
    check = {"test": ["CMD", "test", "-e", str(sign)], "interval": "50ms", "retries": 2}
    stacks.start({"checked": {"command": SERVE, "healthcheck": check}}, wait_healthy=False)
    wait_until(lambda: stacks.row("checked").health is Health.UNHEALTHY, "unhealthy without the sign")
    sign.touch()
    wait_until(lambda: stacks.row("checked").health is Health.HEALTHY, "healthy with it")


def test_healthcheck_that_hangs_counts_as_failed(stacks: Stacks) -> None:
    check = {"test": [*["CMD"], *SERVE], "interval": "50ms", "timeout": "200ms", "retries": 1}
    stacks.start({"checked": {"command": SERVE, "healthcheck": check}}, wait_healthy=False)
    wait_until(lambda: stacks.row("checked").health is Health.UNHEALTHY, "unhealthy")


def test_two_projects_run_side_by_side(stacks: Stacks) -> None:
    services: dict[str, object] = {"one": {"command": SERVE}}
    left, right = stacks.start(services, "left"), stacks.start(services, "right")
    with pytest.raises(AlreadyUpError, match="left"):
        stacks.start(services, "left")
    stop_stack("left", stacks.run_root)
    assert left.services[0].pid is not None and right.services[0].pid is not None
    assert not is_alive(left.services[0].pid)
    assert is_alive(right.services[0].pid)


def test_logs_are_those_of_the_last_stack(stacks: Stacks) -> None:
    stacks.start({"old": {"command": SERVE}})
    wait_until(lambda: stacks.log("old") == ["serving"], "the old one serves")
    stop_stack("test", stacks.run_root)
    assert list(stacks.directory().tails()) == ["old"]
    stacks.start({"new": {"command": SERVE}})
    assert list(stacks.directory().tails()) == ["new"]


def test_completed_dependency_is_waited_for(stacks: Stacks, tmp_path: Path) -> None:
    made = tmp_path / "made"
    state = stacks.start(
        {
            "prepare": {"command": [*PYTHON, f"open({str(made)!r},'w').close()"]},
            "use": {
                "command": [*PYTHON, f"import os,signal;print(os.path.exists({str(made)!r}));signal.pause()"],
                "depends_on": {"prepare": {"condition": "service_completed_successfully"}},
            },
        }
    )
    assert {row.service: row.phase for row in state.services} == {
        "prepare": ServicePhase.EXITED,
        "use": ServicePhase.RUNNING,
    }
    wait_until(lambda: stacks.log("use") == ["True"], "use sees what prepare made")


def test_failed_start_tells_why_and_leaves_nothing(stacks: Stacks) -> None:
    with pytest.raises(StartError, match="no such arm"):
        stacks.start(
            {
                "works": {"command": SERVE},
                "fails": {"command": [*PYTHON, "import sys;sys.exit('no such arm')"]},
                "after": {
                    "command": SERVE,
                    "depends_on": {"fails": {"condition": "service_completed_successfully"}},
                },
            }
        )
    assert not is_up("test", stacks.run_root)


@pytest.mark.parametrize(
    ("service", "said"),
    [
        ({"command": "no-such-program --now"}, "No such file or directory .no-such-program"),
        ({"command": SERVE, "working_dir": "nowhere"}, "No such file or directory .*nowhere"),
    ],
)
def test_what_cannot_be_run_is_said(stacks: Stacks, service: dict[str, object], said: str) -> None:
    with pytest.raises(StartError, match=said):
        stacks.start({"absent": service})


def test_start_gives_up_on_a_service_that_only_restarts(stacks: Stacks) -> None:
    failing = [*PYTHON, "import sys;sys.exit('no bus')"]
    with pytest.raises(StartError, match="no bus"):
        stacks.start({"loops": {"command": failing, "restart": "on-failure", "x-notify": True}})
    assert not is_up("test", stacks.run_root)


def test_wrong_compose_file_is_one_line(stacks: Stacks) -> None:
    compose = stacks.compose({"one": {"command": SERVE, "restrat": "always"}})
    refused = stacks.cli("up", "--file", str(compose))
    assert refused.returncode == 1
    assert refused.stderr == f"{compose}: services.one.restrat: unknown key; did you mean restart?\n"


def test_environment_reaches_the_service(stacks: Stacks, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PASSED_ON", "seen")
    monkeypatch.setenv("SPEED", "max")
    show = "import os,signal;print(os.environ['PASSED_ON'],os.environ['CELL']);signal.pause()"
    stacks.start({"one": {"command": [*PYTHON, show], "environment": {"CELL": "at ${SPEED:-realtime}"}}})
    wait_until(lambda: stacks.log("one") == ["seen at max"], "the environment")


def test_what_somebody_else_stops_comes_back_until_the_stack_is_taken_down(stacks: Stacks) -> None:
    ends_in_order = [*PYTHON, "import signal,sys;signal.signal(15,lambda *_:sys.exit(0));print('on');signal.pause()"]
    stacks.start({"stopped": {"command": ends_in_order, "restart": "unless-stopped"}, "other": {"command": SERVE}})
    wait_until(lambda: "on" in stacks.log("stopped"), "it serves")
    (pid,) = _pids(stacks, "stopped")
    os.kill(pid, signal.SIGTERM)
    wait_until(lambda: stacks.row("stopped").pid not in (None, pid), "it comes back")
    back = _pids(stacks, "stopped", "other")
    stop_stack("test", stacks.run_root)
    assert not any(is_alive(left) for left in back)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_at_the_state_file_ends_no_stack(stacks: Stacks) -> None:
    stacks.start({"killed": {"command": SERVE, "restart": "always"}, "other": {"command": SERVE}})
    wait_until(lambda: stacks.log("killed") == ["serving"], "it serves")
    folder = stacks.directory().path
    (folder / "state.new").symlink_to("/dev/full")  # what is written beside the state meets ENOSPC
    killed, other = _pids(stacks, "killed", "other")
    os.kill(killed, signal.SIGKILL)
    log = stacks.directory().supervisor_log
    wait_until(lambda: "No space left" in log.read_text(), "the stack says so")
    wait_until(lambda: stacks.log("killed").count("serving") == 2, "what was killed runs again all the same")
    assert stacks.row("killed").pid == killed and is_alive(other)
    (folder / "state.new").unlink()
    wait_until(lambda: stacks.row("killed").pid not in (None, killed), "the state is written again")
    wait_until(lambda: "the state is written again" in log.read_text(), "the stack says so once it is")
    assert log.read_text().count("No space left") == 1


def test_a_folder_that_cannot_be_written_is_one_line(stacks: Stacks) -> None:
    (stacks.folder / "run").write_text("a file where the folder would be")
    done = stacks.cli("up", "--detach", "--file", str(stacks.compose({"one": {"command": SERVE}})))
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "CROSSPIH_RUN_DIR" in done.stderr
    (stacks.folder / "run").unlink()


def test_a_malformed_endpoint_is_refused_in_one_line_before_anything_starts(
    stacks: Stacks, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CROSSPIH_ENDPOINT", "127.0.0.1:7447")
    for arguments in (["up"], ["up", "--detach", "--wait"]):
        refused = stacks.cli(*arguments)  # of the shipped file
        assert refused.returncode == 1 and refused.stderr.count("\n") == 1, refused.stderr
        assert "CROSSPIH_ENDPOINT: '127.0.0.1:7447' is no address of a router; write " in refused.stderr
        assert not stacks.run_root.exists()
    for service in ("router", "recorder"):  # by hand
        command = [sys.executable, "-m", f"services.{service}", "--endpoint", "nonsense"]
        ended = subprocess.run(
            command, env=stacks.environment(), capture_output=True, text=True, timeout=60.0, check=False
        )
        assert ended.returncode == CONFIG_STATUS and ended.stderr.count("\n") == 1, ended.stderr
        assert "'nonsense' is no address of a router; write " in ended.stderr
