"""Two hosts, each with a router and services of its own: what lives on one is seen on the other, over mTLS; a link that
is cut is back by itself. Skipped where no hosts can be made."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from crosspih_common.modules import module_command
from services.operator.bench.reliability.hosts.network import Network, why_not
from services.operator.bench.reliability.hosts.stacks import Host, Stacks

HERE = Host("here", "10.77.1.1", ("router",))
THERE = Host("there", "10.77.1.2", ("router", "recorder"), ("here",))
DEADLINE_S = 90.0
pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "hosts can be made")


@pytest.fixture(scope="module")
def network() -> Iterator[Network]:
    with Network({host.name: host.address for host in (HERE, THERE)}) as made:
        yield made


@pytest.fixture(scope="module")
def stacks(network: Network, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stacks]:
    """Routers and a recorder, as `crosspih up` would start them."""
    folder = tmp_path_factory.mktemp("hosts")
    cell = folder / "cell.yaml"
    cell.write_text("cell: {name: hosts}\n")
    made = Stacks(network, (HERE, THERE), folder, cell, "max")
    made.issue_certificates()
    with ExitStack() as ending:
        for host in (HERE, THERE):
            for service in host.services:
                process = subprocess.Popen(
                    network.on(host.name, module_command(f"services.{service}")),
                    env=made.environment(host), cwd=made.folder(host.name), stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT, text=True,
                )  # fmt: skip
                ending.callback(_end, process)
                if service == "router":
                    assert process.stdout is not None and "listening" in process.stdout.readline()
        yield made


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate(timeout=30.0)


def _lives(stacks: Stacks, host: Host, service: str) -> bool:
    return stacks.run(host.name, "crosspih_common.bus.alive", service, "operator").returncode == 0


def _until(holds: Callable[[], bool]) -> None:
    until = time.monotonic() + DEADLINE_S
    while not holds():
        assert time.monotonic() < until


def test_a_service_lives_on_the_other_host_until_the_link_is_cut_and_again_when_it_is_back(
    network: Network, stacks: Stacks
) -> None:
    assert _lives(stacks, HERE, "router")
    _until(lambda: _lives(stacks, HERE, "recorder"))
    network.become(out=[HERE.name])
    _until(lambda: not _lives(stacks, HERE, "recorder"))
    assert _lives(stacks, THERE, "recorder"), "each host's own services go on"
    assert network.become(delay_s=0.02, loss=0.01)["cut"] > 0
    _until(lambda: _lives(stacks, HERE, "recorder"))


def test_a_routers_key_is_not_for_others_to_read(stacks: Stacks) -> None:
    for host in (HERE, THERE):
        keys = sorted(Path(stacks.folder(host.name), "certificates").glob("*.key"))
        assert [key.name for key in keys] == sorted({f"{name}.key" for name in (*host.services, "operator")})
        assert all(key.stat().st_mode & 0o077 == 0 for key in keys)
