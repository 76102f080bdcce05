"""The cell's file that a command is told goes before the one of the environment, for as long as the command lasts."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from crosspih_common.config import load_cell
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.security import CERTIFICATES
from services.operator.assembly.stack import refused_at_once
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.trials import base_cell_text
from services.operator.cell.which_cell import cell_path, using_cell
from services.operator.cli.commands import app


def test_a_named_file_counts_while_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CROSSPIH_CELL", raising=False)
    with using_cell(Path("deploy/cells/panda.yaml")):
        assert cell_path() == str(Path("deploy/cells/panda.yaml").absolute())
    assert cell_path() == DEFAULT_CELL
    monkeypatch.setenv("CROSSPIH_CELL", "mine.yaml")
    with pytest.raises(RuntimeError), using_cell(Path("other.yaml")):
        raise RuntimeError
    assert cell_path() == "mine.yaml"
    with using_cell(None):
        assert cell_path() == "mine.yaml"


def test_where_nobody_listens_no_router_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CERTIFICATES, raising=False)
    with socket.socket() as somebody:
        somebody.bind(("127.0.0.1", 0))
        here = f"tcp/127.0.0.1:{somebody.getsockname()[1]}"
        assert refused_at_once(here)  # bound, but not listening yet
        somebody.listen()
        assert not refused_at_once(here)
    assert refused_at_once(here)
    # where that is not for a plain connection to tell, Zenoh is asked
    assert not refused_at_once(here.replace("tcp", "tls")) and not refused_at_once("serial//dev/ttyS0")
    monkeypatch.setenv(CERTIFICATES, "here")
    assert not refused_at_once(here)


@pytest.mark.parametrize("command", ["pause", "resume", "stop", "withdraw"])
def test_what_needs_a_running_stack_starts_none(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CERTIFICATES, raising=False)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # and does not listen
        monkeypatch.setenv("CROSSPIH_ENDPOINT", f"tcp/127.0.0.1:{nobody.getsockname()[1]}")
        monkeypatch.setattr("services.operator.assembly.stack.start_stack", pytest.fail)
        said = CliRunner().invoke(app, [command])
    assert said.exit_code == 1 and said.output.startswith("no stack runs at tcp/127.0.0.1:"), said.output
    assert "`crosspih up`" in said.output and said.output.count("\n") == 1


@pytest.mark.parametrize("command", ["bench assembly", "bench caps", "bench kills", "withdraw", "dataset collect"])
def test_a_command_names_its_cell_as_assemble_does(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CROSSPIH_CELL", raising=False)
    said = CliRunner().invoke(app, [*command.split(), "--cell", "no-such.yaml"])
    assert said.exit_code == 1 and "no-such.yaml" in said.output, said.output
    assert cell_path() == DEFAULT_CELL


def test_a_cell_written_elsewhere_still_finds_the_files_beside_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arm's URDF, a peg's drawing and a mesh, named from the folder of the file, which is not where we are."""
    lab, other = tmp_path / "lab", tmp_path / "other"
    lab.mkdir()
    other.mkdir()
    (lab / "arm.urdf").write_text(Path("tests/arm/data/ur5e.urdf").read_text(encoding="utf-8"), encoding="utf-8")
    (lab / "peg.svg").write_text(Path("docs/drawings/flower.svg").read_text(encoding="utf-8"), encoding="utf-8")
    cell = {
        "arm": {"urdf": "arm.urdf", "base_link": "base_link", "tip_link": "tool0"},
        "home_joints_rad": [-0.48, -1.94, -1.89, 0.85, 2.0, -2.06],
        "joint_stiffness_nm_rad": [30000] * 6,
        "peg": {"outline": "peg.svg"},
        "surroundings": {"meshes": [{"name": "table", "file": "table.stl", "position_m": [0, 0, -1]}]},
    }
    (lab / "cell.yaml").write_text(yaml.safe_dump({"cell": cell}), encoding="utf-8")
    monkeypatch.setenv("CROSSPIH_CELL", str(lab / "cell.yaml"))
    content = cell_content(base_cell_text(), Condition(overrides={"hardware": {"engine": "mujoco"}}))
    (other / "cell.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    first, again = load_cell(lab / "cell.yaml").workcell, load_cell(other / "cell.yaml").workcell
    assert again.arm().joints == 6 and again.peg.shape().outline == first.peg.shape().outline
    assert Path(again.surroundings.meshes[0].file) == lab / "table.stl"
