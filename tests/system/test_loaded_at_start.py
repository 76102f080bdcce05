"""What a process loads before it is up, and a command before it answers: a stack has eight processes, and who asks how
it fares should not wait for mathematics."""

from __future__ import annotations

import subprocess
import sys

import pytest

SERVICES = (
    "router", "hardware", "vision", "force_torque", "inference", "planning", "recorder", "ros2", "foxglove", "viewer",
)  # fmt: skip
# No service needs these before it is up; torch only where a network is asked, and nobody's pages in a service.
OF_NO_SERVICE = (
    "torch", "safetensors", "matplotlib", "jinja2", "pyarrow", "pinocchio", "pybullet", "mujoco", "typer", "rich",
    "scipy.stats", "scipy.signal", "pandas", "ezdxf", "cryptography",
)  # fmt: skip
# scipy.signal, and scipy.stats with it: the hardware service fits a motion's jerk as soon as the motion ends
BUT = {"hardware": ("scipy.signal", "scipy.stats")}
MATHEMATICS = ("numpy", "scipy", "shapely", "cv2")
UNWANTED = {
    "router": (*OF_NO_SERVICE, *MATHEMATICS, "pydantic", "yaml"),
    "recorder": (*OF_NO_SERVICE, "scipy", "cv2"),
    "force_torque": (*OF_NO_SERVICE, "scipy.optimize", "cv2"),
    "inference": (*OF_NO_SERVICE, "cv2"),
    "planning": (*OF_NO_SERVICE, "scipy.optimize", "cv2"),
    "ros2": (*OF_NO_SERVICE, "scipy.optimize", "cv2"),
    "foxglove": (*OF_NO_SERVICE, "scipy.optimize", "cv2"),
}
# what a command may not have loaded once it has answered, of what its service-side fellows need
OF_NO_QUESTION = ("scipy", "shapely", "cv2", "torch", "matplotlib", "pybullet", "mujoco", "pinocchio", "pyarrow")
OF_NO_LOOK = (*OF_NO_QUESTION, "numpy", "asyncio")
COMMANDS = {
    "--help": (*OF_NO_LOOK, "zenoh", "pydantic", "yaml"),
    "keys": (*OF_NO_LOOK, "zenoh", "yaml"),
    "keys --markdown": (*OF_NO_LOOK, "zenoh", "yaml"),
    "ps": OF_NO_LOOK,
    "ps --json": OF_NO_LOOK,
    "logs": OF_NO_LOOK,
    "down": (*OF_NO_QUESTION, "numpy"),
    "assemble --help": ("torch", "matplotlib", "pybullet", "mujoco", "pinocchio", "scipy.stats", "scipy.signal"),
}


def _loaded(code: str, unwanted: tuple[str, ...]) -> str:
    """Which of these modules are there after some Python, in a process of its own."""
    code += f"\nimport sys; print('loaded', [name for name in {unwanted} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.strip().splitlines()[-1]


@pytest.mark.parametrize("service", SERVICES)
def test_a_service_loads_at_its_start_what_it_needs(service: str) -> None:
    unwanted = tuple(set(UNWANTED.get(service, OF_NO_SERVICE)) - set(BUT.get(service, ())))
    assert _loaded(f"import services.{service}.__main__", unwanted) == "loaded []"


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_loads_what_its_answer_needs(command: str) -> None:
    """Of a stack that is not up: whether one of that name is has to be looked for all the same."""
    words = [*command.split(), *(["--project", "of-no-stack"] if command.split()[0] in ("ps", "logs", "down") else [])]
    code = (
        "from services.operator.cli.commands import app\n"
        f"try:\n    app({words})\n"
        "except SystemExit:\n    pass"
    )  # fmt: skip
    assert _loaded(code, COMMANDS[command]) == "loaded []"


def test_an_assembly_and_its_page_need_no_package_that_set_up_leaves_out() -> None:
    """`make assemble` installs the extra `run` alone."""
    needed = ("assembly.commands.assemble", "report.page", "report.figure")
    code = "import " + ", ".join(f"services.operator.{module}" for module in needed)
    left_out = (
        "torch",
        "safetensors",
        "pinocchio",
        "pyarrow",
        "ezdxf",
        "cryptography",
        "rosbags",
        "pymodbus",
        "serial",
        "ray",
    )
    assert _loaded(code, left_out) == "loaded []"


def test_who_lives_is_asked_without_mathematics() -> None:
    """What `crosspih ps` loads for a stack that is up."""
    code = (
        "import services.operator.cli.ps\n"
        "from crosspih_common.bus import Bus, open_zenoh\n"
        "from crosspih_common.config import cell_name\n"
        "from crosspih_common.modules import DEFAULT_CELL\n"
        "from crosspih_common.service.wall_clock import measured\n"
        "cell_name(DEFAULT_CELL)"
    )
    assert _loaded(code, OF_NO_QUESTION) == "loaded []"
