"""Fixtures for tests against zenoh-ros2-sdk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.ros2.sdk import SdkProcess


@pytest.fixture
def sdk(endpoint: str, tmp_path: Path) -> Iterator[Callable[..., SdkProcess]]:
    """Start the SDK's process with these arguments at the test's router."""
    pytest.importorskip("zenoh_ros2_sdk")
    started: list[SdkProcess] = []

    def start(*arguments: str, domain: int = 0) -> SdkProcess:
        folder = tmp_path / f"definitions-{len(started)}"
        folder.mkdir()
        started.append(SdkProcess(endpoint, folder, *arguments, domain=domain))
        return started[-1]

    yield start
    for process in reversed(started):
        process.close()
