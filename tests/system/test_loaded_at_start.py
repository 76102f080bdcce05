"""What a process loads before it is up: a stack has eight of them, and a router that was lost is waited for."""

from __future__ import annotations

import subprocess
import sys

import pytest

SLOW = ("scipy.stats", "scipy.signal", "matplotlib", "torch", "pinocchio")
STARTED = (
    "services.force_torque.__main__", "services.inference.__main__", "services.operator.assemble",
    "services.planning.__main__", "services.recorder.__main__", "services.vision.__main__",
)  # fmt: skip


@pytest.mark.parametrize(
    ("modules", "unwanted"),
    [(("services.router.__main__",), ("numpy", "scipy", "pydantic")), (STARTED, SLOW)],
    ids=["router", "services and commands"],
)
def test_what_only_some_calls_need_is_not_loaded_at_the_start(
    modules: tuple[str, ...], unwanted: tuple[str, ...]
) -> None:
    code = f"import sys, {', '.join(modules)}; print([name for name in {unwanted} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.strip() == "[]", done.stdout + done.stderr
