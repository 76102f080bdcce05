"""Who may know what, read from the source: the truth, other services, torch, and the spelling of keys."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

from crosspih_common.keys import commands, topics
from tests.system.source import ROOT, files_below, nodes_of

SERVICES = sorted(folder.name for folder in (ROOT / "services").iterdir() if (folder / "__main__.py").exists())
PRODUCT = [path for top in ("crosspih_common", "deploy", "services") for path in files_below(ROOT / top)]
KEY_TABLE = ROOT / "crosspih_common" / "keys.py"
KNOW_THE_TRUTH = ("hardware", "operator")
NAMED_FUNCTION = re.compile(r"(services|deploy)(\.\w+)+:\w+")
# their arguments are written in the source: modules and folders
FEW_ARGUMENTS = {"part_version", "folder_version", "code_version"}
A_FILES_KIND = "crosspih/ft-calibration"  # stands in the calibration file; no key
OTHERS_ALLOWED = {"operator": ("deploy",)}


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Every module that a file imports, wherever in it: relative ones in full, and those named "module:function"."""
    return tuple(imported_in(nodes_of(path), path))


def imported_in(nodes: Iterable[ast.AST], path: Path) -> Iterator[str]:
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and NAMED_FUNCTION.fullmatch(node.value):
            yield node.value.split(":")[0]


@cache
def text_of(path: Path) -> frozenset[str]:
    """Every string of a file, the parts of f-strings included, docstrings left out."""
    described = {
        id(node.body[0].value)
        for node in nodes_of(path)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    return frozenset(
        node.value
        for node in nodes_of(path)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in described
    )


def names_of(path: Path) -> Iterator[str]:
    for node in nodes_of(path):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.alias):
            yield node.name.rsplit(".", 1)[-1]


def files_of(service: str) -> list[Path]:
    return [path for path in PRODUCT if path.is_relative_to(ROOT / "services" / service)]


def test_what_is_measured_and_shown_needs_no_command_line() -> None:
    """Typer is for what is typed: files called command, commands, options or app, and folders of commands."""
    for path in files_of("operator"):
        folders = {*path.relative_to(ROOT).parts}
        typed = (
            path.stem in ("command", "commands", "options", "app") or {"cli", "commands", "export", "topic"} & folders
        )
        assert typed or "typer" not in {name.split(".")[0] for name in imported(path)}, path


def test_the_services_are_found() -> None:
    known = {"hardware", "vision", "force_torque", "inference", "planning", "recorder", "operator", "ros2", "viewer"}
    assert known <= set(SERVICES)


@pytest.mark.parametrize("service", [name for name in SERVICES if name not in KNOW_THE_TRUTH])
def test_the_truth_is_known_to_scoring_only(service: str) -> None:
    for path in files_of(service):
        assert not {"TRUTH", "SimulationTruth"} & set(names_of(path)), path
        assert not [text for text in text_of(path) if "simulation/truth" in text or "SimulationTruth" in text], path


@pytest.mark.parametrize("service", SERVICES)
def test_no_service_imports_another(service: str) -> None:
    allowed = ("crosspih_common", f"services.{service}", *OTHERS_ALLOWED.get(service, ()))
    own = ("crosspih_common", "services", "deploy", "tests")
    for path in files_of(service):
        for module in imported(path):
            if module.split(".")[0] in own:
                assert any(module == name or module.startswith(f"{name}.") for name in allowed), (path, module)


def test_what_all_share_imports_no_service() -> None:
    for path in PRODUCT:
        if path.is_relative_to(ROOT / "crosspih_common"):
            for module in imported(path):
                assert module.split(".")[0] not in ("services", "deploy", "tests"), (path, module)


def test_torch_is_imported_by_inference_only() -> None:
    for path in PRODUCT:
        if not path.is_relative_to(ROOT / "services" / "inference"):
            modules = {module.split(".")[0] for module in imported(path)}
            assert not modules & {"torch", "safetensors"}, path


def test_ros_is_spoken_by_the_bridge_the_driver_and_the_export_only() -> None:
    """Nothing of ROS 2 reaches planning, control or the arm but through these."""
    hardware = "services/hardware/drivers/ros2", "services/hardware/peers/ros2"
    speaking = "crosspih_common/ros2", "services/ros2", "services/operator/recordings/export", *hardware
    settings = ROOT / "services" / "hardware" / "config.py"  # knows the driver's section
    for path in PRODUCT:
        if any(path.is_relative_to(ROOT / where) for where in speaking):
            continue
        modules = set(imported(path))
        assert not [name for name in modules if name.startswith("rosbags")], path
        if path != settings:
            assert not [name for name in modules if name.startswith("crosspih_common.ros2")], path


def test_the_bridge_holds_no_lease_and_commands_no_motion() -> None:
    """What ROS asks of the bridge goes to planning as a command of ours, or nowhere."""
    motions = {"LEASE_TAKE", "FOLLOW", "MOVE_LINEAR", "GUARDED_MOVE", "ADMITTANCE_MOVE", "DWELL", "SET_PAYLOAD"}
    for path in files_of("ros2"):
        assert not motions & set(names_of(path)), path
        assert not [name for name in imported(path) if name.startswith("crosspih_common.holding")], path


def test_the_page_holds_no_lease_and_commands_no_motion() -> None:
    """What its buttons ask goes to planning, which holds the arm meanwhile, or is refused."""
    motions = {"LEASE_TAKE", "FOLLOW", "MOVE_LINEAR", "GUARDED_MOVE", "ADMITTANCE_MOVE", "DWELL", "SET_PAYLOAD", "STOP"}
    for path in files_of("viewer"):
        assert not motions & set(names_of(path)), path
        assert not [name for name in imported(path) if name.startswith("crosspih_common.holding")], path


def test_coal_is_imported_where_a_collision_model_is_made_only() -> None:
    for path in PRODUCT:
        modules = {module.split(".")[0] for module in imported(path)}
        assert "coal" not in modules or path == ROOT / "crosspih_common" / "collision" / "shapes.py", path


@pytest.mark.parametrize("service", [name for name in SERVICES if name not in ("hardware", "planning")])
def test_collisions_are_checked_where_motions_are_made_only(service: str) -> None:
    for path in files_of(service):
        if path.is_relative_to(ROOT / "services" / "operator" / "calibrate"):
            continue  # it drives the arm itself, and looks for postures that are clear
        modules = set(imported(path))
        assert not [name for name in modules if name.startswith("crosspih_common.collision")], path


def test_a_physics_engine_is_imported_by_its_own_folder_only() -> None:
    simulated = ROOT / "services" / "hardware" / "drivers" / "simulated"
    for engine in ("pybullet", "mujoco"):
        own = simulated / "engines" / engine
        for path in PRODUCT:
            drawn = engine == "pybullet" and path == simulated / "scene" / "tiny_renderer.py"
            if not path.is_relative_to(own) and not drawn:
                assert engine not in {module.split(".")[0] for module in imported(path)}, path


def test_keys_are_spelled_in_the_table_only() -> None:
    for path in PRODUCT:
        if path != KEY_TABLE:
            spelled = [text for text in text_of(path) if "crosspih/" in text and text != A_FILES_KIND]
            assert not spelled, (path, spelled)


def test_no_path_of_the_table_is_spelled_elsewhere() -> None:
    paths = {path for path in [*(one.path for one in topics()), *(one.path for one in commands())] if "/" in path}
    for path in PRODUCT:
        if path != KEY_TABLE:
            assert not paths & text_of(path), path


def test_the_control_layer_knows_no_driver_and_no_engine() -> None:
    control = ROOT / "services" / "hardware" / "control"
    for path in sorted(control.rglob("*.py")):
        modules = set(imported(path))
        assert not [name for name in modules if name.startswith("services.hardware.drivers")], path
        assert not {name.split(".")[0] for name in modules} & {"pybullet", "mujoco", "cv2"}, path


def test_no_service_but_the_simulated_driver_imports_an_engine() -> None:
    simulated = ROOT / "services" / "hardware" / "drivers" / "simulated"
    for path in PRODUCT:
        if not path.is_relative_to(simulated):
            modules = {module.split(".")[0] for module in imported(path)}
            assert not modules & {"pybullet", "mujoco"}, path


def test_what_a_service_keeps_of_what_it_computed_has_an_end() -> None:
    """A table without a limit is for what takes no arguments: others grow with what is seen, hour after hour."""
    for path in PRODUCT:
        for node in nodes_of(path):
            if not isinstance(node, ast.FunctionDef) or node.name in FEW_ARGUMENTS:
                continue
            limits = {ast.unparse(one).removeprefix("functools.") for one in node.decorator_list}
            if limits & {"cache", "lru_cache(None)", "lru_cache(maxsize=None)"}:
                assert not ast.unparse(node.args), (path, node.name)
