"""How the tests are shared out to the workers; fixtures for tests over real processes: a router on a free port, and
services beside it."""

from __future__ import annotations

import compileall
import gc
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import settings
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling, Scheduling

# before NumPy and torch are loaded: workers beside each other have one core each, and so have the services they start
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# The tests start some hundreds of processes, and each would compile all of our source anew where nothing may be kept.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Collecting makes a million objects that stay, which Python's garbage collector would go through time and again: a
# quarter of the collection's time. It is at work again before the first test.
gc.disable()

# The same examples in every run: what they do not find the first time they never will, so there are fewer than
# Hypothesis' hundred. HYPOTHESIS_PROFILE=explore looks for new ones.
settings.register_profile("same", derandomize=True, deadline=None, max_examples=50)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

ROOT = Path(__file__).resolve().parent.parent
START_S = 120.0  # a process reads its imports for half a minute beside twenty busy ones
END_S = 10.0
PACKAGES = ("crosspih_common", "services", "deploy")


# Files whose tests start processes and wait for them with a deadline: they run one after another in one worker, while
# the others compute, so that no two cells run beside each other. It mostly waits, so two others fill two cores.
WITH_PROCESSES = frozenset([
    "tests/bus/test_zenoh_bus.py",
    "tests/deploy/test_any_folder.py",
    "tests/deploy/test_stack.py",
    "tests/hardware/drivers/ati/test_ati.py",
    "tests/hardware/drivers/genicam/test_genicam.py",
    "tests/hardware/drivers/genicam/test_genicam_rendered.py",
    "tests/hardware/drivers/test_robotiq.py",
    "tests/hardware/drivers/ur/test_ur_driver.py",
    "tests/hardware/drivers/ur/test_ur_with_a_cell.py",
    "tests/hardware/drivers/ur/test_ur_witness.py",
    "tests/holding/test_lease.py",
    "tests/hosts/test_two_hosts.py",
    "tests/operator/bench/cells/test_pool.py",
    "tests/operator/bench/cells/test_stopped.py",
    "tests/operator/bench/test_speed_benches.py",
    "tests/ros2/test_action.py",
    "tests/ros2/test_arm_driver.py",
    "tests/ros2/test_bridge.py",
    "tests/ros2/test_camera_driver.py",
    "tests/recorder/test_recording_over_processes.py",
    "tests/security/test_attacks.py",
    "tests/service/test_lifecycle.py",
    "tests/system/test_as_bench.py",
    "tests/system/test_cell_check.py",
    "tests/system/test_client.py",
    "tests/system/test_commands.py",
    "tests/system/test_examples.py",
    "tests/system/test_genicam_from_cell.py",
    "tests/system/test_line_arm.py",
    "tests/system/test_lost_services.py",
    "tests/system/test_one_assembly.py",
    "tests/system/test_plain_zenoh_client.py",
    "tests/system/test_rejected.py",
    "tests/system/test_stop.py",
    "tests/system/test_without_simulator.py",
    "tests/viewer/test_in_a_browser.py",
    "tests/viewer/test_page_over_loopback.py",
])  # fmt: skip
BEHIND = 10  # nice: a tenth of a core where what was started wants it
STARTERS = frozenset(["bare", "router", "sdk", "secured", "spawn", "stacks", "sdk_arm"])


_begun = False


class _ByFile(LoadFileScheduling):  # type: ignore[misc]  # xdist has no types
    """`--dist loadfile`, but what starts processes is one group."""

    def _split_scope(self, nodeid: str) -> str:
        file = str(super()._split_scope(nodeid))
        return "processes" if file in WITH_PROCESSES else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes() -> None:
    """Our source is compiled once, before the workers and all that they start import it side by side."""
    for package in PACKAGES:
        compileall.compile_dir(ROOT / package, quiet=2, workers=0)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Scheduling | None:
    """Files in the order of `pytest_collection_modifyitems`, not by their number of tests."""
    if config.getoption("dist") != "loadfile":
        return None
    config.option.loadscopereorder = False
    return _ByFile(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What starts processes comes first: it takes longest. Fails on a file that starts some and is not in the list."""
    files = {item: item.nodeid.split("::")[0] for item in items}
    items.sort(key=lambda item: files[item] not in WITH_PROCESSES)
    for item, file in files.items():
        if STARTERS & set(getattr(item, "fixturenames", ())) and file not in WITH_PROCESSES:
            raise pytest.UsageError(f"{file} starts processes: add it to WITH_PROCESSES in tests/conftest.py")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A worker that begins with what only computes goes behind what the other one starts and waits for."""
    global _begun
    computes = item.nodeid.split("::")[0] not in WITH_PROCESSES
    if not _begun and computes and hasattr(item.config, "workerinput") and hasattr(os, "nice"):
        os.nice(BEHIND)
    _begun = True


def pytest_collection_finish() -> None:
    """What was loaded and collected stays for good: the garbage collector need not look at it again."""
    gc.collect()
    gc.freeze()
    gc.enable()


class ServiceProcess:
    """`python -m services.<name> ...` as a child process; its output is collected line by line."""

    def __init__(self, name: str, *arguments: str) -> None:
        self.name = name
        self.output: list[str] = []
        self._lines: queue.Queue[str | None] = queue.Queue()
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        for variable in ("CROSSPIH_CELL", "CROSSPIH_ENDPOINT", "NOTIFY_SOCKET"):
            environment.pop(variable, None)
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"services.{name}", *arguments],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.output.append(line)
            self._lines.put(line)
        self._lines.put(None)

    def wait_for_line(self, text: str, deadline_s: float = START_S) -> bool:
        """Whether a line with this text comes before the process ends; fails the test at the deadline."""
        until = time.monotonic() + deadline_s
        while True:
            try:
                line = self._lines.get(timeout=max(until - time.monotonic(), 0.001))
            except queue.Empty:
                pytest.fail(f"{self.name} did not print {text!r} within {deadline_s} s: {''.join(self.output)}")
            if line is None:
                return False
            if text in line:
                return True

    def kill(self) -> None:
        """kill -9, and wait until it is gone."""
        self.process.kill()
        self._reap()

    def terminate(self) -> int:
        """SIGTERM; kill -9 if it does not end. The exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(END_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
        self._reap()
        return self.process.returncode

    def _reap(self) -> None:
        self.process.wait(END_S)
        self._reader.join(END_S)
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def spawn() -> Iterator[Callable[..., ServiceProcess]]:
    """Start `python -m services.<name> ...`; whatever still runs at the end of the test is ended, by its own pid."""
    started: list[ServiceProcess] = []

    def start(name: str, *arguments: str) -> ServiceProcess:
        started.append(ServiceProcess(name, *arguments))
        return started[-1]

    yield start
    for process in reversed(started):
        process.terminate()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass(frozen=True)
class Router:
    """A router as a process of its own, on a free loopback port."""

    process: ServiceProcess
    endpoint: str


def started_router(
    spawn: Callable[..., ServiceProcess] = ServiceProcess, *arguments: str
) -> tuple[ServiceProcess, str]:
    """A router that listens, and where; whoever starts it without `spawn` ends it."""
    process: ServiceProcess | None = None
    for _ in range(3):
        where = f"tcp/127.0.0.1:{_free_port()}"
        process = spawn("router", "--endpoint", where, *arguments)
        try:
            if process.wait_for_line("listening on"):
                return process, where
        except BaseException:
            process.terminate()
            raise
    assert process is not None
    pytest.fail(f"no router: {''.join(process.output)}")


@pytest.fixture
def router(spawn: Callable[..., ServiceProcess]) -> Router:
    """A router that listens."""
    return Router(*started_router(spawn))


@pytest.fixture
def endpoint(router: Router) -> str:
    """The endpoint of a router that listens."""
    return router.endpoint
