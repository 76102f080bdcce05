"""The certificates' files, what `security show` finds wrong with them, and the rules made from the key table."""

from __future__ import annotations

import json
import re
import stat
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from typer.testing import CliRunner

from crosspih_common.errors import ConfigError
from crosspih_common.keys import (
    CLOCK,
    FT_CALIBRATION,
    IDENTIFY_PAYLOAD,
    LEASE_BEAT,
    LOCATE,
    STATUS,
    TRUTH,
    Command,
    alive_key,
    commands,
    topics,
)
from crosspih_common.security import CERTIFICATES, Credentials, credentials_from_environment, open_to_whom
from crosspih_common.security.access import SERVICES, access_control, allowed
from deploy.launcher.certificates import require_certificates
from deploy.launcher.compose import Service
from deploy.launcher.errors import LauncherError
from services.operator.cli.commands import app
from services.operator.security.issuing import issue_all
from services.operator.security.looking import look
from services.router.refusals_log import ACCESS_REFUSED, LINK_REFUSED, RefusalEvent, RefusalsLog

RUNNER = CliRunner()
TOLD_TO_ROS2 = ("planning/assemble", "vision/locate")
TOLD_TO_FOXGLOVE = (
    "camera/capture", "inference/advise_insertion", "inference/estimate", "inference/network", "inference/seated",
    "inference/sequence_network", *TOLD_TO_ROS2,
)  # fmt: skip
ASKED_SHOWN_BY_FOXGLOVE = ("arm/follow/request", "planning/assemble/request")
TOLD_TO_VIEWER = (
    *TOLD_TO_ROS2, "planning/withdraw", "inference/estimate", "inference/seated", "inference/network",
    "inference/sequence_network",
)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "certificates"
    issue_all(folder, SERVICES, ["localhost", "127.0.0.1"], days=100.0)
    return folder


@pytest.fixture
def copied(made: Path, tmp_path: Path) -> Path:
    for file in made.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
        (tmp_path / file.name).chmod(stat.S_IMODE(file.stat().st_mode))
    return tmp_path


def test_nobody_else_may_read_a_key(made: Path) -> None:
    assert stat.S_IMODE(made.stat().st_mode) == 0o700
    keys = list(made.glob("*.key"))
    assert len(keys) == len(SERVICES) + 1
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}


def test_each_certificate_names_its_service_and_can_be_used(made: Path) -> None:
    rows = look(made, SERVICES)
    assert [row.name for row in rows] == ["ca", *SERVICES]
    assert not [row for row in rows if row.wrong]
    router = x509.load_pem_x509_certificate(Credentials(made, "router").certificate.read_bytes())
    names = router.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert [str(name) for name in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1"]


def test_show_tells_what_is_wrong(copied: Path, made: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    other = tmp_path_factory.mktemp("other") / "certificates"
    issue_all(other, ["vision"], [], days=1.0)
    (copied / "vision.pem").write_bytes((other / "vision.pem").read_bytes())
    (copied / "planning.key").write_bytes((made / "hardware.key").read_bytes())
    (copied / "inference.pem").write_bytes((made / "hardware.pem").read_bytes())
    (copied / "recorder.key").chmod(0o640)
    (copied / "ros2.pem").unlink()
    (copied / "camera.pem").write_text("nothing\n")
    wrong = {row.name: row.wrong for row in look(copied, SERVICES)}
    assert wrong == dict.fromkeys(["ca", *SERVICES], "") | {
        "vision": "not signed by ca.pem",
        "planning": "planning.key is not its key",
        "inference": "is of hardware",
        "recorder": "others may read recorder.key",
        "ros2": "cannot be read: No such file or directory",
        "camera": "camera.pem is no certificate",
    }
    later = datetime.now(timezone.utc) + timedelta(days=101)
    assert {row.wrong for row in look(made, SERVICES, later)} == {"expired"}


def test_init_overwrites_nothing_unasked(tmp_path: Path) -> None:
    folder = tmp_path / "certificates"
    first = RUNNER.invoke(app, ["security", "init", "--folder", str(folder), "--days", "3"])
    assert first.exit_code == 0 and "they end on" in first.output
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    again = RUNNER.invoke(app, ["security", "init", "--folder", str(folder)])
    assert again.exit_code == 1 and "--overwrite" in again.output
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    anew = RUNNER.invoke(app, ["security", "init", "--folder", str(folder), "--overwrite"])
    assert anew.exit_code == 0 and (folder / "ca.pem").read_bytes() != before["ca.pem"]
    shown = RUNNER.invoke(app, ["security", "show", "--folder", str(folder), "--json"])
    assert shown.exit_code == 0
    assert {row["name"] for row in json.loads(shown.output)["certificates"]} == {"ca", *SERVICES}


def test_a_folder_of_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "work.txt").write_text("mine")
    refused = RUNNER.invoke(app, ["security", "init", "--folder", str(tmp_path)])
    assert refused.exit_code == 1 and "other things" in refused.output
    assert [file.name for file in tmp_path.iterdir()] == ["work.txt"]


def test_certificates_that_cannot_be_used_are_told_before_anything_starts(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CERTIFICATES, str(copied))
    assert credentials_from_environment("vision", "tcp/127.0.0.1:7447") == Credentials(copied.resolve(), "vision")
    (copied / "vision.key").chmod(0o644)
    with pytest.raises(ConfigError, match="others may read"):
        credentials_from_environment("vision", "tcp/127.0.0.1:7447")
    (copied / "vision.key").unlink()
    with pytest.raises(ConfigError, match=r"vision\.key is not there"):
        credentials_from_environment("vision", "tcp/127.0.0.1:7447")


def test_up_names_the_services_that_a_folder_of_an_older_version_lacks(
    copied: Path,
) -> None:
    for kind in ("pem", "key"):
        (copied / f"viewer.{kind}").unlink()
    (copied / "planning.key").unlink()
    services = {
        name: Service(command=["true"], environment={CERTIFICATES: str(copied)})
        for name in ("planning", "router", "viewer")
    }
    with pytest.raises(LauncherError, match=r"no certificate and key for planning, viewer.*security init --folder"):
        require_certificates(services)
    del services["planning"], services["viewer"]
    require_certificates(services)


def test_an_endpoint_of_tls_wants_certificates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CERTIFICATES, raising=False)
    assert credentials_from_environment("operator", "tcp/127.0.0.1:7447") is None
    with pytest.raises(ConfigError, match=f"certificate alone; set {CERTIFICATES}"):
        credentials_from_environment("operator", "tls/localhost:7447")


def test_a_plain_stack_says_who_can_command_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CERTIFICATES, raising=False)
    assert "anyone on this machine can command this cell" in open_to_whom("tcp/127.0.0.1:7447")
    assert "anyone on this machine can command this cell" in open_to_whom("tcp/[::1]:7447")
    assert "anyone who reaches 192.168.1.10" in open_to_whom("tcp/192.168.1.10:7447")


# -------------------------------------------------------------------------------------------------------------- rules


def may(flow: str, message: str, key: str) -> set[str]:
    """The services of whom a key is allowed: by its letters, `*` of a rule for one chunk."""
    found = set()
    for (service, its_flow, its_message), keys in allowed().items():
        patterns = ("[^/]+".join(map(re.escape, rule.split("*"))) for rule in keys if "**" not in rule)
        if (its_flow, its_message) == (flow, message) and any(re.fullmatch(pattern, key) for pattern in patterns):
            found.add(service)
    return found


def test_only_its_publisher_writes_a_topic_and_only_its_readers_are_sent_it() -> None:
    for topic in topics():
        if topic.publisher != "{service}":
            beside = {"camera"} if topic.path.startswith("camera/") else set[str]()
            assert may("ingress", "put", topic.key("cell1")) == {topic.publisher} | beside, topic.path
            readers = set(SERVICES) if topic is CLOCK else set(topic.readers)
            if topic.path.endswith("/reply"):  # the operator's benches hear every answer, ROS 2 and the page some
                command = topic.path[: -len("/reply")]
                readers |= {"operator"} | ({"ros2"} if command in TOLD_TO_ROS2 else set())
                readers |= {"viewer"} if command in TOLD_TO_VIEWER else set()
                readers |= {"foxglove"} if command in TOLD_TO_FOXGLOVE else set()
            if topic.path in ASKED_SHOWN_BY_FOXGLOVE:
                readers |= {"foxglove"}
            assert may("egress", "put", topic.key("cell1")) == readers, topic.path
            assert may("ingress", "declare_subscriber", topic.key("cell1")) == readers, topic.path
    assert may("ingress", "put", CLOCK.key("cell1")) == {"hardware"}
    assert may("ingress", "put", FT_CALIBRATION.key("cell1")) == {"force_torque"}
    assert may("egress", "put", TRUTH.key("cell1")) == {"operator", "recorder"}
    assert may("ingress", "put", STATUS.key("cell1", "vision")) == {"vision"}
    assert may("ingress", "put", LEASE_BEAT.key("cell1", "planning")) == {"planning"}
    assert may("ingress", "put", LEASE_BEAT.key("cell1", "vision")) == set()


def test_only_its_callers_ask_a_command_and_only_its_server_answers() -> None:
    def servers(command: Command[Any, Any]) -> set[str]:
        return {command.server} | ({"camera"} if command.path == "camera/capture" else set())

    for command in commands():
        key = command.key("cell1")
        assert may("ingress", "query", key) == set(command.callers), command.path
        assert may("egress", "query", key) == may("ingress", "reply", key) == servers(command), command.path
        assert may("ingress", "declare_queryable", key) == servers(command), command.path
    assert may("ingress", "query", IDENTIFY_PAYLOAD.key("cell1")) == {"planning"}
    assert may("ingress", "query", LOCATE.key("cell1")) == {"planning", "operator"}


def test_a_service_lives_under_its_own_name() -> None:
    assert may("ingress", "liveliness_token", alive_key("cell1", "vision")) == {"vision"}
    assert may("ingress", "liveliness_token", alive_key("cell1", "camera")) == {"camera", "hardware"}


def test_what_no_rule_allows_is_denied() -> None:
    control = access_control()
    assert control["default_permission"] == "deny"
    assert {rule["permission"] for rule in control["rules"]} == {"allow"}
    assert {subject["id"]: subject["cert_common_names"] for subject in control["subjects"]} == {
        service: [service] for service in SERVICES
    }
    named = [name for policy in control["policies"] for name in policy["rules"]]
    assert sorted(named) == sorted(rule["id"] for rule in control["rules"])
    for policy in control["policies"]:
        assert all(name.startswith(f"{policy['subjects'][0]} ") for name in policy["rules"])


# ---------------------------------------------------------------------------------------------------------- Zenoh's log

ACL = "TRACE rx-1 ThreadId(09) zenoh::net::routing::interceptor::access_control: "
KNOWN = ACL + "d45e on Interface(lo)+CertCommonName(vision)+Transport(Tls)+d45e "
KEY = "crosspih/c/force_torque/calibration"


def test_the_routers_log_is_read() -> None:
    log = RefusalsLog()
    assert log.read(f"{ACL}ACL (ingress): caching permissions for `{KEY}` ...") is None
    assert log.read(f"{KNOWN}is unauthorized to Put (ingress) on {KEY}") is None  # worked out beforehand
    assert log.read(f"{ACL}Using cached result: d45e is authorized to Put (ingress) on crosspih/c/x") is None
    said = RefusalEvent(ACCESS_REFUSED, f"the certificate of vision may not publish on {KEY}")
    assert log.read(f"{ACL}Using cached result: d45e is unauthorized to Put (ingress) on {KEY}") == said
    asked = RefusalEvent(ACCESS_REFUSED, "the certificate of vision may not ask crosspih/c/arm/stop")
    assert log.read(f"{KNOWN}is unauthorized to Query (ingress) on crosspih/c/arm/stop") == asked
    assert log.read(f"{KNOWN}is unauthorized to Put (egress) on crosspih/c/arm/stop") is None
    # worked out for one session, and then asked for by another on the same thread
    assert log.read(f"{ACL}ACL (ingress): caching permissions for `crosspih/c/arm/stop` ...") is None
    server = ACL + "77aa on Interface(lo)+CertCommonName(hardware)+Transport(Tls)+77aa "
    assert log.read(f"{server}is unauthorized to Query (ingress) on crosspih/c/arm/stop") is None
    assert log.read(f"{KNOWN}is unauthorized to Query (ingress) on crosspih/c/arm/stop") == asked
    warned = "\x1b[33m WARN\x1b[0m acc-0 ThreadId(06) \x1b[2mzenoh_link_tls::unicast\x1b[0m\x1b[2m:\x1b[0m "
    hint = ". Hint: increase the system open file limit."
    said = RefusalEvent(LINK_REFUSED, "a connection was refused: it showed no certificate")
    assert log.read(f"{warned}peer sent no certificates{hint}") == said
    expired = f"{warned}invalid peer certificate: certificate expired: verification time 17 (UNIX){hint}"
    assert log.read(expired) == RefusalEvent(LINK_REFUSED, "a connection was refused: its certificate has expired")
    assert log.read(f"{warned}something else{hint}") == RefusalEvent(
        LINK_REFUSED, "a connection was refused: something else"
    )
