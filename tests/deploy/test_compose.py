"""What a compose file may say, and how what it may not say is refused."""

import string
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.launcher import DEFAULT_COMPOSE_FILE, ComposeError, StackRequest
from deploy.launcher.compose import ComposeFile, parse_duration_s
from deploy.launcher.conditions import StartCondition
from deploy.launcher.interpolation import interpolate
from deploy.launcher.loading import load_compose, parse_compose
from deploy.launcher.order import select, start_levels
from deploy.launcher.restart import RestartPolicy, RestartWhen
from tests.deploy.harness import ROOT

FULL = """
name: cell
x-anything: &base
  working_dir: sub
  environment: {SPEED: "${SPEED:-realtime}", COUNT: 3, HOME:}
services:
  router:
    <<: *base
    command: python -m "services router" --port 7447
    healthcheck:
      test: [CMD, test, -e, file]
      interval: 1m30s
      timeout: 500ms
      retries: 5
      start_period: 1.5s
    restart: on-failure:4
    stop_grace_period: 1s
  user:
    command: [python, -m, services.user, 5]
    environment: [A=1=2, HOME]
    depends_on: [router]
    restart: no
    profiles: [extra]
    x-notify: true
    x-watchdog_s: 2.5
"""


def _services(body: str) -> ComposeFile:
    return parse_compose("services:\n" + body, {})


def _faults(text: str, variables: dict[str, str] | None = None) -> list[str]:
    with pytest.raises(ComposeError) as refused:
        parse_compose(text, variables or {}, "c.yaml")
    return [str(fault) for fault in refused.value.faults]


def test_every_key_is_read() -> None:
    compose = parse_compose(FULL, {"SPEED": "max"})
    router, user = compose.services["router"], compose.services["user"]
    assert compose.name == "cell"
    assert router.command == ("python", "-m", "services router", "--port", "7447")
    assert router.environment == {"SPEED": "max", "COUNT": "3", "HOME": None}
    assert router.working_dir == "sub"
    assert router.restart == RestartPolicy(RestartWhen.ON_FAILURE, 4)
    assert router.healthcheck is not None
    assert router.healthcheck.test == ("test", "-e", "file")
    check = router.healthcheck
    assert (check.interval, check.timeout, check.retries, check.start_period) == (90.0, 0.5, 5, 1.5)
    assert router.stop_grace_period == 1.0
    assert user.command == ("python", "-m", "services.user", "5")
    assert user.environment == {"A": "1=2", "HOME": None}
    assert user.depends_on["router"].condition is StartCondition.STARTED
    assert user.restart == RestartPolicy(RestartWhen.NO)
    assert (user.profiles, user.notify, user.watchdog_s) == (("extra",), True, 2.5)


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("  a: {command: x, restrat: always}", "services.a.restrat: unknown key; did you mean restart?"),
        ("  a: {command: x, x-notfy: true}", "services.a.x-notfy: unknown key; did you mean x-notify?"),
        (
            "  a: {command: x, ports: ['1:1']}",
            "services.a.ports: unknown key; services are local processes here and have no containers: remove it",
        ),
        (
            "  a: {command: x, healthcheck: {test: y, intervall: 1s}}",
            "services.a.healthcheck.intervall: unknown key; did you mean interval?",
        ),
        ("  a: {restart: always}", "services.a.command: missing; add command:"),
        ("  a: {command: ''}", "services.a.command: no command; write a line"),
        ("  a: {command: 'x \"y'}", "services.a.command: 'x \"y' cannot be split"),
        ("  a: {command: x, restart: sometimes}", "services.a.restart: 'sometimes' is not a restart policy; write"),
        (
            "  a: {command: x, stop_grace_period: 2}",
            "services.a.stop_grace_period: 2 is not a duration; write a number with a unit",
        ),
        ("  a: {command: x, environment: {A: true}}", 'A is a YAML boolean; quote it: A: "true"'),
        ("  a: {command: x, healthcheck: {interval: 1s}}", "services.a.healthcheck: no test; add test:"),
        ("  a: {command: x, healthcheck: {test: [GET, /]}}", "services.a.healthcheck.test: ['GET', '/'] is not a test"),
        (
            "  a: {command: x, x-working_dir: .., working_dir: /srv}",
            "services.a: has both x-working_dir and working_dir; keep the one",
        ),
        ("  a: {command: x, x-watchdog_s: 1}", "services.a: x-watchdog_s without x-notify; add x-notify: true"),
        ("  a: {command: x, depends_on: [b]}", "services.a.depends_on.b: no such service; services are a"),
        (
            "  router: {command: x}\n  a: {command: x, depends_on: [ruoter]}",
            "services.a.depends_on.ruoter: no such service; did you mean router?",
        ),
        (
            "  b: {command: x}\n  a: {command: x, depends_on: {b: {condition: service_healthy}}}",
            "services.a.depends_on.b: waits for b to be healthy, which has no way to be; give b a healthcheck",
        ),
        (
            "  b: {command: x}\n  a: {command: x, depends_on: {b: {condition: healthy}}}",
            "services.a.depends_on.b.condition: 'healthy' is not known; write 'service_started'",
        ),
        (
            "  a: {command: x, depends_on: [b]}\n  b: {command: x, depends_on: [a]}",
            "goes round: a -> b -> a; remove one of these",
        ),
    ],
)
def test_fault_names_field_and_mend(body: str, expected: str) -> None:
    (fault,) = _faults("services:\n" + body)
    assert expected in fault


def test_all_faults_are_told_at_once() -> None:
    text = "services:\n  a: {command: x, ports: ['1:1']}\n  b: {restart: 7}\nversion: '3'\n"
    assert [fault.split(":")[0] for fault in _faults(text)] == [
        "services.a.ports",
        "services.b.command",
        "services.b.restart",
        "version",
    ]


@pytest.mark.parametrize("text", ["", "- a", "services:", "services: {}", "services: [", "services: {a: 1}"])
def test_what_is_no_compose_file_is_refused(text: str) -> None:
    assert _faults(text)


def test_absent_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ComposeError, match="No such file or directory; name a compose file"):
        load_compose(tmp_path / "none.yaml", {})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("$SET-${SET}", "value-value"),
        ("${UNSET:-default}", "default"),
        ("${EMPTY:-default}", "default"),
        ("${EMPTY-default}", ""),
        ("${UNSET-}", ""),
        ("${SET:+other}${EMPTY:+other}${EMPTY+there}", "otherthere"),
        ("${UNSET:-${SET}/${UNSET:-deep}}", "value/deep"),
        ("${SET:?needed}", "value"),
        ("$$SET $${SET}", "$SET ${SET}"),
    ],
)
def test_variables(text: str, expected: str) -> None:
    assert interpolate(text, {"SET": "value", "EMPTY": ""}) == (expected, [])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("$UNSET", "the variable UNSET is not set; set UNSET in the environment or write ${UNSET:-default}"),
        ("${UNSET:?say where}", "the variable UNSET is required: say where"),
        ("${EMPTY:?}", "the variable EMPTY is required: not set"),
        ("${SET", "'${' without '}'"),
        ("100 $ ", "write '$$' for a dollar sign"),
        ("${}", "no variable name"),
        ("${SET!x}", "unknown operator"),
    ],
)
def test_refused_variables_name_their_field(text: str, expected: str) -> None:
    (fault,) = _faults(f"services: {{a: {{command: [x, '{text}']}}}}", {"SET": "value", "EMPTY": ""})
    assert fault.startswith("services.a.command.1: ")
    assert expected in fault


@given(st.text())
def test_escaped_text_stays_as_it_was(text: str) -> None:
    assert interpolate(text.replace("$", "$$"), {}) == (text, [])


@given(st.integers(0, 99), st.integers(0, 59), st.integers(0, 999))
def test_durations_add_up(minutes: int, seconds: int, milliseconds: int) -> None:
    expected_s = minutes * 60 + seconds + milliseconds * 1e-3
    assert parse_duration_s(f"{minutes}m{seconds}s{milliseconds}ms") == pytest.approx(expected_s)


@given(st.lists(st.sets(st.integers(0, 11)), max_size=12))
def test_levels_come_after_what_they_need(edges: list[set[int]]) -> None:
    # A service depends on earlier ones only, so there is no circle.
    names = string.ascii_lowercase
    body = "".join(
        f"  {names[i]}: {{command: x, depends_on: [{', '.join(names[j] for j in sorted(needs) if j < i)}]}}\n"
        for i, needs in enumerate(edges or [set()])
    )
    services = _services(body).services
    levels = start_levels(services)
    rank = {name: index for index, level in enumerate(levels) for name in level}
    assert sorted(rank) == sorted(services)
    assert all(rank[needed] < rank[name] for name, service in services.items() for needed in service.depends_on)


def test_selection_brings_what_is_needed_and_respects_profiles() -> None:
    services = _services(
        "  a: {command: x}\n  b: {command: x, depends_on: [a]}\n  c: {command: x, profiles: [p]}\n"
        "  d: {command: x, profiles: [p], depends_on: [c]}\n"
    ).services
    assert list(select(services, (), ())) == ["a", "b"]
    assert list(select(services, (), ("p",))) == ["a", "b", "c", "d"]
    assert list(select(services, ("b",), ())) == ["a", "b"]
    assert list(select(services, ("c",), ())) == ["c"]
    with pytest.raises(ComposeError, match="d: needs c, whose profile is off; add --profile p"):
        select(services, ("d",), ())
    with pytest.raises(ComposeError, match="no such service"):
        select(services, ("z",), ())


def test_what_is_installed_comes_by_itself_and_what_is_not_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "compose.yaml"
    file.write_text(
        "services:\n  a: {command: x}\n  b: {command: x, profiles: [b], x-up_where_installed: json}\n"
        "  c: {command: x, profiles: [c], x-up_where_installed: no_such_module}\n"
    )
    request = StackRequest(compose_file=file)
    assert list(request.chosen()) == ["a"]
    assert list(request.with_what_comes_by_itself().chosen()) == ["a", "b"]
    named = StackRequest(compose_file=file, services=("a",))
    assert named.with_what_comes_by_itself() == named


def test_shipped_file_starts_the_router_first_and_every_service_exists() -> None:
    services = load_compose(DEFAULT_COMPOSE_FILE, {}).services
    others = {"hardware", "vision", "force_torque", "inference", "planning", "recorder"}
    assert [set(level) for level in start_levels(select(services, (), ()))] == [{"router"}, others]
    optional = {"ros2", "foxglove", "viewer"}  # where their profiles are asked for
    assert set(services) - {"router"} - others == optional
    assert set(select(services, (), tuple(optional))) == set(services)
    for name, service in services.items():
        assert service.command == ("python", "-m", f"services.{name}")
        assert (ROOT / "services" / name).is_dir()
        assert service.environment["CROSSPIH_ENDPOINT"] == "tcp/127.0.0.1:7447"
        assert service.has_health


def test_shipped_file_takes_its_settings_from_the_environment() -> None:
    services = load_compose(DEFAULT_COMPOSE_FILE, {"CROSSPIH_ENDPOINT": "tcp/127.0.0.1:9", "CROSSPIH_SPEED": "max"})
    environment = services.services["planning"].environment
    assert (environment["CROSSPIH_ENDPOINT"], environment["CROSSPIH_SPEED"]) == ("tcp/127.0.0.1:9", "max")


@pytest.mark.parametrize(
    "endpoint", ["nonsense", "tcp/127.0.0.1", "tcp/127.0.0.1:0", "tcp/127.0.0.1:70000", "tcp//x:7"]
)
def test_what_is_no_address_is_refused_once_by_its_field_and_mend(endpoint: str) -> None:
    with pytest.raises(ComposeError) as refused:
        load_compose(DEFAULT_COMPOSE_FILE, {"CROSSPIH_ENDPOINT": endpoint})
    assert str(refused.value).count("\n") == 0
    said = f"CROSSPIH_ENDPOINT: {endpoint!r} is no address of a router; write PROTOCOL/HOST:PORT, such as tcp/"
    assert said in str(refused.value)


def test_addresses_stand_in_commands_too_and_in_lists() -> None:
    command = "command: [python, -m, services.router, --endpoint, {0}, --listen=tcp/10.0.0.1:7448]"
    assert _faults(f"services: {{router: {{{command.format('oops')}}}}}") == [
        "services.router.command --endpoint: 'oops' is no address of a router; write PROTOCOL/HOST:PORT, such as "
        "tcp/127.0.0.1:7447"
    ]
    sound = "services: {router: {" + command.format('"tcp/[::1]:7447"') + "}}"
    assert parse_compose(sound, {"CROSSPIH_ROUTERS": "tcp/host:1, tls/10.0.0.2:7448?iface=eth0"})
    (fault,) = _faults(sound, {"CROSSPIH_ROUTERS": "tcp/host:1, host:2"})
    assert fault.startswith("CROSSPIH_ROUTERS: 'host:2' is no address")


def test_the_secure_file_is_the_plain_one_with_certificates() -> None:
    plain = load_compose(DEFAULT_COMPOSE_FILE, {}).services
    secure_file = DEFAULT_COMPOSE_FILE.with_name("compose.secure.yaml")
    secure = load_compose(secure_file, {"CROSSPIH_CERTIFICATES": "/certificates"}).services
    assert list(secure) == list(plain)
    for name, service in secure.items():
        certificates = {"CROSSPIH_CERTIFICATES": "/certificates"}
        assert service.environment == plain[name].environment | certificates
        assert service.model_copy(update={"environment": {}}) == plain[name].model_copy(update={"environment": {}})
    with pytest.raises(ComposeError, match="crosspih security init"):
        load_compose(secure_file, {})
