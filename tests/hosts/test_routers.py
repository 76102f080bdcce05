"""What a router is told of other machines' routers: where it listens, whom it connects to, what they may do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import zenoh

from crosspih_common.bus.zenoh_transport import router_config
from crosspih_common.security import Credentials
from crosspih_common.security.access import ROUTER, SERVICES, access_control

LOOPBACK, OUTSIDE, THERE = "tcp/127.0.0.1:7447", "tcp/10.0.0.1:7448", "tcp/10.0.0.2:7448"


def setting(config: zenoh.Config, name: str) -> Any:
    return json.loads(config.get_json(name))


def test_one_machine_s_router_listens_on_its_endpoint_alone_and_connects_to_nobody() -> None:
    config = router_config(LOOPBACK)
    assert setting(config, "listen/endpoints") == [LOOPBACK]
    assert setting(config, "connect/endpoints") == []


@pytest.mark.parametrize(("secure", "kind"), [(False, "tcp/"), (True, "tls/")])
def test_addresses_beyond_loopback_are_those_that_were_asked_for(tmp_path: Path, secure: bool, kind: str) -> None:
    credentials = Credentials(tmp_path, ROUTER) if secure else None
    config = router_config(LOOPBACK, False, credentials, [OUTSIDE], [THERE])
    assert setting(config, "listen/endpoints") == [LOOPBACK.replace("tcp/", kind), OUTSIDE.replace("tcp/", kind)]
    assert setting(config, "connect/endpoints") == [THERE.replace("tcp/", kind)]
    assert setting(config, "scouting/multicast/enabled") is False
    if secure:
        assert setting(config, "transport/link/tls/enable_mtls") is True
        assert setting(config, "transport/link/tls/connect_certificate") == str(tmp_path / "router.pem")
        assert setting(config, "access_control/default_permission") == "deny"


def of(service: str, control: dict[str, Any]) -> dict[str, list[str]]:
    """A service's rules by name, with their keys."""
    (names,) = (policy["rules"] for policy in control["policies"] if policy["subjects"] == [service])
    return {rule["id"]: rule["key_exprs"] for rule in control["rules"] if rule["id"] in names}


def test_another_router_speaks_for_all_its_services_only_where_routers_are_linked() -> None:
    alone, linked = access_control(), access_control(other_routers=True)
    assert "crosspih/**" not in of(ROUTER, alone).get("router ingress put", [])
    assert "crosspih/**" in of(ROUTER, linked)["router ingress put"]
    for service in set(SERVICES) - {ROUTER}:
        assert of(service, alone) == of(service, linked), service
