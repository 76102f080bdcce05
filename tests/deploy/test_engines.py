"""The compose file is one for container engines too: by the Compose specification's own schema, and as podman-compose
reads it.

compose-spec.json is the published schema, as it is (github.com/compose-spec/compose-spec, commit 170098b, Apache-2.0).
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from deploy.launcher import DEFAULT_COMPOSE_FILE
from deploy.launcher.compose import ENGINE_KEYS
from deploy.launcher.loading import load_compose, parse_compose
from tests.deploy.harness import ROOT

SCHEMA = Path(__file__).with_name("compose-spec.json")
DATA = "/var/lib/crosspih"


@pytest.fixture(scope="module")
def tree() -> dict[str, Any]:
    read: dict[str, Any] = yaml.safe_load(DEFAULT_COMPOSE_FILE.read_text(encoding="utf-8"))
    return read


@pytest.fixture(scope="module")
def schema() -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))


def test_the_published_schema_accepts_the_file(tree: dict[str, Any], schema: jsonschema.Draft7Validator) -> None:
    assert [error.message for error in schema.iter_errors(tree)] == []
    tree["services"]["router"]["restart_policy"] = "always"
    assert not schema.is_valid(tree)
    del tree["services"]["router"]["restart_policy"]


def test_the_schema_knows_every_key_that_the_launcher_leaves_to_an_engine(schema: jsonschema.Draft7Validator) -> None:
    known: dict[str, Any] = schema.schema["definitions"]["service"]["properties"]  # type: ignore[index]
    assert known.keys() >= ENGINE_KEYS


def test_every_service_is_in_one_image_on_the_hosts_network_and_has_its_own_check(tree: dict[str, Any]) -> None:
    for name, service in tree["services"].items():
        assert service["network_mode"] == "host" and service["image"] and service["build"]["dockerfile"]
        assert service["healthcheck"]["test"] == ["CMD", "python", "-m", "crosspih_common.bus.alive", name]
        assert f"data:{DATA}" in service["volumes"] and "working_dir" not in service
    assert (ROOT / "deploy" / "Dockerfile").read_text(encoding="utf-8").count(DATA) >= 2


def test_the_launcher_goes_by_the_notification_and_leaves_the_check_to_an_engine() -> None:
    service = load_compose(DEFAULT_COMPOSE_FILE, {}).services["planning"]
    assert service.notify and service.healthcheck is not None and service.check is None
    engines = "  a: {command: x, image: y, volumes: [d:/d], network_mode: host, healthcheck: {test: z}}"
    alone = parse_compose(f"services:\n{engines}\nvolumes: {{d: }}\n", {}).services["a"]
    assert alone.check is not None and alone.check.test == ("/bin/sh", "-c", "z")


@pytest.mark.skipif(shutil.which("podman") is None, reason="podman-compose asks for a program podman")
@pytest.mark.skipif(find_spec("podman_compose") is None, reason="no podman-compose: pip install 'crosspih[dev]'")
def test_podman_compose_reads_what_the_launcher_reads() -> None:
    profiles = [word for name in ("ros2", "foxglove", "viewer") for word in ("--profile", name)]
    words = ["--file", str(DEFAULT_COMPOSE_FILE), *profiles, "config"]
    done = subprocess.run(
        [sys.executable, "-m", "podman_compose", *words], capture_output=True, text=True, check=True, timeout=60.0
    )
    theirs = yaml.safe_load(done.stdout)["services"]
    ours = load_compose(DEFAULT_COMPOSE_FILE, {}).services
    assert theirs.keys() == ours.keys()
    for name, service in ours.items():
        assert tuple(theirs[name]["command"]) == service.command
        assert {key: value or "" for key, value in theirs[name]["environment"].items()} == service.environment
