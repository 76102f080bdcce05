"""The answers as a cell's file, commented."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from crosspih_common.config import CameraSection, HolePrior
from services.operator.cell.init.answers import NONE, SAME
from services.operator.cell.init.questions import SIMULATED, Answers, base_content, hole_pose

LENSES = "distortion: [-0.082, 0.021, 0.0004, -0.0003]"  # as the shipped cells have them
COLUMN = 36  # column at which comments begin
DRIVERS_OF_A_FILE = ("pictures", "video", "genicam")


def cell_text(given: Answers, path: Path, settings: dict[str, str]) -> str:
    """The file's text. `settings` are the drivers' settings for an address, below `hardware`."""
    content = base_content(given)
    pose = hole_pose(given["hole_position_m"], given["hole_axis"])
    # the cameras stand before the hole as in the default cell
    camera = pose @ HolePrior().pose_base_hole().inverse() @ CameraSection().pose_base_camera()
    arm = content["arm"]
    if "urdf" in arm:
        arm = {**arm, "urdf": _beside(arm["urdf"], path)}
    peg = dict(content["peg"])
    if os.path.sep in str(peg.get("outline", "")):
        peg["outline"] = _beside(peg["outline"], path)
    lines = [
        "# Made by `crosspih cell init`; `crosspih doctor --cell` this file says what is still missing.",
        "# Metres, radians, newtons; the base's frame is the arm's. What is not named here has its default.",
        "cell:",
        _line("  name", given["name"], "the prefix of its keys on the bus"),
        _line("  arm", arm, "docs/arms.md"),
        _line("  home_joints_rad", content["home_joints_rad"], "where it begins, far from everything"),
    ]
    if "joint_stiffness_nm_rad" in content:
        lines.append(
            _line("  joint_stiffness_nm_rad", content["joint_stiffness_nm_rad"], "crosspih calibrate stiffness")
        )
    lines += [
        _line("  flange_to_ft", content["flange_to_ft"], "where the sensor measures, seen from the flange"),
        _noted("  force_torque:", "how the sensor's numbers are to be read: docs/force-torque.md"),
        _line("    reports", given["sensor_reports"], "load: a push against the tip reads -Fz; else reaction"),
        _line("  peg", peg, "docs/pegs.md"),
        "  hole:",
        _line("    clearance_m", given["clearance_m"], "on every side"),
        _noted("  hole_prior:", "where the hole is, roughly: its axes and its place in the base's frame"),
        "    matrix_base_hole:",
        *(f"      - {_flow(_rounded(row))}" for row in pose.matrix()[:3]),
        _line("    half_range_lateral_m", given["hole_range_m"], "how far it may be from there"),
        _noted("  surroundings:", "what the arm keeps clear of: docs/surroundings.md"),
        _line("    floor_height_m", given["floor_height_m"], "over the base's origin; null: there is none"),
        _noted("  camera:", "the left camera: z ahead, x right, y down; crosspih calibrate hand-eye"),
        "    matrix_base_camera:",
        *(f"      - {_flow(_rounded(row))}" for row in camera.matrix()[:3]),
    ]
    if given["driver"] == SIMULATED:
        lines.append(f"    {LENSES}")
    lines += _hardware(given, settings)
    return "\n".join(lines) + "\n"


def _hardware(given: Answers, settings: dict[str, str]) -> list[str]:
    lines = ["hardware:", _line("  driver", given["driver"], "crosspih cell drivers lists them")]
    others = {"force_torque": given.get("sensor_driver", SAME), "camera": given["camera_driver"]}
    named = {device: driver for device, driver in others.items() if driver not in (SAME, NONE)}
    if named:
        lines.append(_line("  drivers", named, "of one device each"))
    if given["camera_driver"] == NONE:
        lines.append(_line("  devices", ["arm", "force_torque"], "no cameras: assemble --strategy force_alone"))
    sections: dict[str, dict[str, Any]] = {}
    addresses = ("driver", "address"), ("sensor_driver", "sensor_address"), ("camera_driver", "camera_address")
    for driver, answer in addresses:
        where = settings.get(str(given.get(driver)), "")
        if where and given.get(answer) is not None:
            section, _, field = where.partition(".")
            sections.setdefault(section, {})[field] = given[answer]
    if given.get("camera_right") is not None:
        sections.setdefault(str(given["camera_driver"]), {})["right"] = given["camera_right"]
    if given.get("camera_calibration") and given["camera_driver"] in DRIVERS_OF_A_FILE:
        sections.setdefault(given["camera_driver"], {})["calibration"] = given["camera_calibration"]
    for section, fields in sections.items():
        lines.append(f"  {section}:")
        lines += [f"    {field}: {_flow(value)}" for field, value in fields.items()]
    lines += [_noted("  limits:", "docs/safety.md"), _line("    force_cap_n", given["force_cap_n"], "of contact")]
    for field in () if given["driver"] == SIMULATED else ("moved_mass_kg", "contact_stiffness_n_m"):
        value = given.get(field)
        if value is None:
            lines.append(f"    # {field}:  the driver's own, else the strictest is taken: slow touches")
        else:
            lines.append(f"    {field}: {_flow(value)}")
    return lines


def _line(key: str, value: Any, comment: str) -> str:
    return _noted(f"{key}: {_flow(value)}", comment)


def _noted(text: str, comment: str) -> str:
    return f"{text:<{COLUMN}}  # {comment}"


def _beside(file: str, path: Path) -> str:
    """A path as the cell's file writes it: relative to its own folder."""
    return os.path.relpath(file, path.resolve().parent)


def _rounded(values: Any) -> list[float]:
    return [float(value) + 0.0 for value in np.round(np.asarray(values, dtype=float), 9)]


def _flow(value: Any) -> str:
    """YAML in one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=sys.maxsize, sort_keys=False, allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")
