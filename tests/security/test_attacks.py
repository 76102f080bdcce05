"""Attacks on a cell with certificates, over real processes on loopback: each is refused, and an event names it."""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
import trustme
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from crosspih_common.bus.codec import encode, label_of, label_with_seq
from crosspih_common.bus.zenoh_transport import ZenohTransport
from crosspih_common.errors import BusError
from crosspih_common.keys import FT_CALIBRATION, IDENTIFY_PAYLOAD, STATUS, STOP, TRUTH, author_key
from crosspih_common.messages import FtCalibration, IdentifyPayload, StopAccepted, StopMotion
from crosspih_common.security import CERTIFICATES, Credentials
from crosspih_common.security.access import SERVICES
from services.operator.security.issuing import Authority, issue_all, write_pair
from tests.bus.test_zenoh_bus import ask_until_there
from tests.conftest import ServiceProcess, started_router
from tests.force_torque.made_calibrations import FORGED
from tests.security.attacks import CELL, DEADLINE_S, Secured, asked_outright, listening_ports


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Secured]:
    """A router and force_torque as processes; the other services are this process, each with its own certificate."""
    folder = tmp_path_factory.mktemp("cell")
    cell_file, certificates = folder / "cell.yaml", folder / "certificates"
    cell_file.write_text(f"cell: {{name: {CELL}}}\nforce_torque: {{calibration_file: {folder}/ft.yaml}}\n")
    issue_all(certificates, SERVICES, ["127.0.0.1"], days=1.0)
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv(CERTIFICATES, str(certificates))
        router, endpoint = started_router(ServiceProcess, "--cell", str(cell_file))
        running = Secured(certificates, cell_file, router, endpoint)
        try:
            yield running
        finally:
            running.close()


@pytest.fixture(autouse=True)
def printed(secured: Secured, record_property: Callable[[str, object], None]) -> Iterator[None]:
    """What the attack had for an answer, into the results of `--junitxml`: docs/security.md quotes it."""
    secured.told.clear()
    yield
    for told in secured.told:
        record_property("printed", told)


def wait_for_force_torque(secured: Secured) -> None:
    with secured.bus("ros2") as ros2:  # of those who may read a status
        assert ros2.latest(STATUS).wait_for(lambda status: status.service == "force_torque", DEADLINE_S) is not None


def sessions_of_the_cell(secured: Secured) -> set[str]:
    """The router's, force_torque's and the operator's: asked until all are there, for one answer may lack some."""
    transport = secured.operator._transport
    assert isinstance(transport, ZenohTransport)
    until, pause = time.monotonic() + DEADLINE_S, threading.Event()
    while True:
        authors = {key.split("/")[-1] for key in transport.living(author_key(CELL))}
        routers = {str(router) for router in transport.session.info.routers_zid()}
        if len(found := authors | routers | {transport.author}) >= 3:
            return found
        assert time.monotonic() < until, f"authors {authors}, routers {routers}"
        pause.wait(0.05)


# -------------------------------------------------------------------------------------------------------------- links


def test_without_a_certificate(secured: Secured) -> None:
    assert secured.stays_out(None)
    assert secured.event("link_refused", "showed no certificate").service == "router"


def test_with_a_certificate_of_another_authority(secured: Secured, tmp_path: Path) -> None:
    issued = trustme.CA().issue_cert(common_name="operator")
    issued.cert_chain_pems[0].write_to_path(tmp_path / "operator.pem")
    issued.private_key_pem.write_to_path(tmp_path / "operator.key")
    assert secured.stays_out(Credentials(tmp_path, "operator"))
    secured.event("link_refused", "another authority")


def test_with_a_certificate_that_has_expired(secured: Secured, tmp_path: Path) -> None:
    key = load_pem_private_key((secured.folder / "ca.key").read_bytes(), None)
    now = datetime.now(timezone.utc)
    expired = Authority(
        key,  # type: ignore[arg-type]
        x509.load_pem_x509_certificate((secured.folder / "ca.pem").read_bytes()),
        now - timedelta(days=2),
        now - timedelta(days=1),
    )
    write_pair(Credentials(tmp_path, "operator"), *expired.issue("operator", []))
    assert secured.stays_out(Credentials(tmp_path, "operator"))
    secured.event("link_refused", "expired")


def test_without_tls(secured: Secured) -> None:
    config = secured.intruder(None, **{"connect/endpoints": [secured.endpoint]})
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
    secured.event("link_refused", "does not speak TLS")


def test_a_peer_that_goes_round_the_router_finds_nobody(secured: Secured) -> None:
    wait_for_force_torque(secured)
    assert listening_ports(secured.force_torque.process.pid) == set()
    assert len(listening_ports(secured.router.process.pid)) == 1
    of_the_cell = sessions_of_the_cell(secured)
    alone = {"mode": "peer", "connect/endpoints": [], "listen/endpoints": ["tcp/127.0.0.1:0"],
             "scouting/multicast/enabled": True, "scouting/multicast/interface": "lo"}  # fmt: skip
    found: queue.Queue[str] = queue.Queue()
    with zenoh.open(secured.intruder(None, **alone)) as peer:
        own, seen = str(peer.zid()), Counter[str]()
        looking = zenoh.scout(
            lambda hello: found.put(str(hello.zid)),  # type: ignore[arg-type]  # its stub has one overload of three
            "peer|router",
            secured.intruder(None, **alone),
        )
        # whoever answers does so to each of its calls: he finds himself twice, and none of the cell
        while seen[own] < 2:
            seen[found.get(timeout=DEADLINE_S)] += 1
        looking.stop()
        assert not seen.keys() & of_the_cell


# ------------------------------------------------------------------------------------------------------- certificates


def test_vision_commands_the_arm(secured: Secured) -> None:
    asked: list[StopMotion] = []

    def stop(request: StopMotion) -> StopAccepted:
        asked.append(request)
        return StopAccepted(was_moving=False)

    with secured.bus("hardware") as hardware, secured.bus("vision") as vision:
        hardware.serve(STOP, stop)
        with secured.bus("planning") as planning:
            assert ask_until_there(planning).was_moving is False
        before = len(asked)
        with pytest.raises(BusError):
            asked_outright(vision, STOP, StopMotion())
        assert len(asked) == before
    secured.event("access_refused", "vision may not ask", STOP.key(CELL))


def test_vision_writes_the_calibration(secured: Secured) -> None:
    wait_for_force_torque(secured)
    latest = secured.operator.latest(FT_CALIBRATION)
    assert latest.wait_for(lambda one: not one.calibrated, DEADLINE_S) is not None  # what force_torque says of itself
    with secured.bus("vision") as vision:
        transport = vision._transport
        assert isinstance(transport, ZenohTransport)
        # not by a declared publisher: that is told of no reader, and so sends nothing
        transport.session.put(
            FT_CALIBRATION.key(CELL), encode(FORGED), attachment=label_with_seq(FtCalibration, 0).encode()
        )
        secured.event("access_refused", "vision may not publish on", FT_CALIBRATION.key(CELL))
        with pytest.raises(BusError):
            asked_outright(vision, IDENTIFY_PAYLOAD, IdentifyPayload(readings=()))
    secured.event("access_refused", "vision may not ask", IDENTIFY_PAYLOAD.key(CELL))
    value = latest.value()
    assert value is not None and not value.calibrated
    assert not (secured.cell_file.parent / "ft.yaml").exists()


def test_inference_reads_the_truth(secured: Secured) -> None:
    with secured.bus("inference") as inference:
        inference.latest(TRUTH)
        secured.event("access_refused", "inference may not", TRUTH.key(CELL))


def test_a_second_service_of_one_name(secured: Secured) -> None:
    wait_for_force_torque(secured)
    second = secured.start("force_torque")
    try:
        assert second.wait_for_line("second_service")
        assert second.process.wait(DEADLINE_S) == 1
    finally:
        second.terminate()
    secured.event("second_service", "force_torque")
    assert secured.force_torque.process.poll() is None


def test_identify_is_the_planners_alone(secured: Secured) -> None:
    """With the operator's own certificate: the router stops it before force_torque is asked."""
    wait_for_force_torque(secured)
    transport = secured.operator._transport
    with pytest.raises(BusError):
        transport.query(
            IDENTIFY_PAYLOAD.key(CELL), encode(IdentifyPayload(readings=())), label_of(IdentifyPayload), 2.0
        )
    secured.event("access_refused", "operator may not ask", IDENTIFY_PAYLOAD.key(CELL))


def test_no_key_is_told(secured: Secured) -> None:
    """What the processes wrote so far holds nothing of a private key, nor of where its bytes are."""
    written = "".join([*secured.router.output, *secured.force_torque.output])
    assert "listening on tls/" in written
    for file in secured.folder.glob("*.key"):
        body = file.read_text().splitlines()[1]
        assert body not in written
    assert "PRIVATE KEY" not in written
