"""The questions, in order; each knows what was answered before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

import deploy
from crosspih_common.config import HolePrior, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.plain_yaml import text_of_file, yaml_of
from services.operator.cell.init import answers as of
from services.operator.cell.init.answers import NONE, SAME, InvalidAnswer
from services.operator.cli.rows import Verdict
from services.operator.doctor.drawing import reach_rows

CELLS = Path(deploy.__file__).resolve().parent / "cells"
SIMULATED = "simulated"
Answers = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Question:
    """`read` converts a text to the answer or raises Refused; `asked` says whether to ask the question, given the
    answers before it; `default` is the answer of a bare Enter, None where there is none.
    """

    key: str
    text: str
    read: Callable[[str, Answers], Any]
    default: Callable[[Answers], str | None]
    asked: Callable[[Answers], bool] = lambda given: True


def hole_pose(position_m: tuple[float, ...], axis: tuple[float, ...]) -> Pose:
    """The hole, its z along the axis, its x as near to upwards as can be (along the base's x for an upright axis)."""
    z = np.asarray(axis) / np.linalg.norm(axis)
    up = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    x = up - z * (up @ z)
    x /= np.linalg.norm(x)
    return Pose(np.column_stack([x, np.cross(z, x), z]), np.asarray(position_m, dtype=float))


def known_cell(arm: Any) -> dict[str, Any]:
    """The section `cell` of the shipped cell of a named arm, for defaults; empty where there is none."""
    file = CELLS / f"{arm.get('name') if isinstance(arm, dict) else ''}.yaml"
    if not file.is_file():
        return {}
    content: dict[str, Any] = yaml_of(text_of_file(file))["cell"]
    return content


def default_hole(given: Answers) -> Pose:
    """The hole of the shipped cell of that arm, else the default cell's."""
    prior = HolePrior.model_validate(known_cell(given.get("arm")).get("hole_prior") or {})
    return prior.pose_base_hole()


def base_content(given: Answers) -> dict[str, Any]:
    """The section `cell` as far as it has been answered."""
    arm = given["arm"]
    content: dict[str, Any] = {"name": given["name"], "arm": arm}
    if "name" not in arm:
        content["home_joints_rad"] = list(given["home_joints_rad"])
        content["joint_stiffness_nm_rad"] = [given["joint_stiffness_nm_rad"]] * of.joints_of(arm)
    else:
        content["home_joints_rad"] = list(given.get("home_joints_rad") or of.default_home(arm) or ())
    content["flange_to_ft"] = {"position_m": [0.0, 0.0, given["sensor_distance_m"]]}
    if "peg" in given:
        content["peg"] = given["peg"]
    if "clearance_m" in given:
        content["hole"] = {"clearance_m": given["clearance_m"]}
    return content


def _clearance(text: str, given: Answers) -> float:
    value = of.number(text, 1e-5, 0.002, "metres on every side")
    try:
        Workcell.model_validate({**base_content(given), "hole": {"clearance_m": value}})
    except ValidationError as error:
        raise InvalidAnswer(of.why(error)) from None
    return value


def _axis(text: str, given: Answers) -> tuple[float, ...]:
    axis = of.numbers(text, 3, "the direction into the hole, in the base's frame: 0 0 -1 is downwards")
    if not 1e-3 < float(np.linalg.norm(axis)) < 1e6:
        raise InvalidAnswer("want a direction, such as 0 0 -1")
    matrix = hole_pose(given["hole_position_m"], axis).matrix()[:3].tolist()
    content = {**base_content(given), "hole_prior": {"matrix_base_hole": matrix}}
    try:
        cell = Workcell.model_validate(content)
        row = next(iter(reach_rows(cell)))
    except (ValidationError, ValueError) as error:
        raise InvalidAnswer(of.why(error)) from None
    if row.verdict is Verdict.WRONG:
        raise InvalidAnswer(f"{row.found}; another direction, or begin again with another place (hole_position_m)")
    return axis


def _position(text: str, given: Answers) -> tuple[float, ...]:
    place = of.numbers(text, 3, "x y z of the hole's middle on the plate's face, m, in the base's frame")
    if not 0.05 < float(np.linalg.norm(place)) < 3.0:
        raise InvalidAnswer("want metres from the arm's base, .05 to 3 m away: 0.4 -0.3 0.2")
    return place


def _words(values: Any) -> str:
    return " ".join(f"{value:g}" for value in np.round(np.asarray(values, dtype=float), 4))


def questions(drivers: list[dict[str, Any]]) -> list[Question]:
    """All of them; `drivers` are those that `crosspih cell drivers` lists."""
    setting_of = {str(one["name"]): str(one["address"]) for one in drivers}

    def setting(given: Answers, key: str) -> str:
        return setting_of.get(str(given.get(key)), "")

    def own(given: Answers) -> bool:
        return "name" not in given["arm"]

    def real(given: Answers) -> bool:
        return str(given["driver"]) != SIMULATED

    def two(given: Answers) -> bool:
        """Whether the two cameras are separate devices, with an address each."""
        return setting(given, "camera_driver").endswith(".left")

    return [
        Question("name", "The cell's name", lambda t, g: of.name(t), lambda g: "cell1"),
        Question("arm", "The arm: xb4, ur5e, panda, a URDF file, or a YAML file with its DH table",
                 lambda t, g: of.arm(t), lambda g: "ur5e"),
        Question("home_joints_rad", "A posture to begin in, rad, joint by joint",
                 lambda t, g: of.home(t, g["arm"]), lambda g: None, own),
        Question("joint_stiffness_nm_rad", "The stiffness of its joints, Nm/rad (later: crosspih calibrate stiffness)",
                 lambda t, g: of.number(t, 100.0, 1e7, "Nm/rad"), lambda g: "20000", own),
        Question("driver", "Its driver, or your own module:function",
                 lambda t, g: of.driver(t, drivers, "arm"), lambda g: SIMULATED),
        Question("address", "The arm's address", lambda t, g: of.address(t, setting(g, "driver")), lambda g: None,
                 lambda g: bool(setting(g, "driver"))),
        Question("sensor_driver", "The force/torque sensor's driver; same: the arm's own",
                 lambda t, g: SAME if t == SAME else of.driver(t, drivers, "force_torque"), lambda g: SAME, real),
        Question("sensor_address", "The sensor's address", lambda t, g: of.address(t, setting(g, "sensor_driver")),
                 lambda g: None, lambda g: bool(setting(g, "sensor_driver"))),
        Question("sensor_distance_m", "From the flange to where the sensor measures, along the tool, m",
                 lambda t, g: of.number(t, 0.001, 0.5, "metres"), lambda g: "0.0663"),
        Question("sensor_reports", "A push against the tip reads -Fz (load) or +Fz (reaction)",
                 lambda t, g: of.choice(t, ("load", "reaction")), lambda g: "load"),
        Question("camera_driver", "The cameras' driver; same: the arm's; none: the hole is felt for",
                 lambda t, g: t if t in (SAME, NONE) else of.driver(t, drivers, "camera"),
                 lambda g: SAME if g["driver"] == SIMULATED else NONE),
        Question("camera_address", "The left camera's address, serial number or name",
                 lambda t, g: of.address(t, setting(g, "camera_driver")), lambda g: None, two),
        Question("camera_right", "The right camera's address, serial number or name",
                 lambda t, g: of.address(t, setting(g, "camera_driver")), lambda g: None, two),
        Question("camera_calibration", "The cameras' calibration file, or none: calibrated later",
                 lambda t, g: None if t == NONE else of.calibration(t), lambda g: NONE,
                 lambda g: g["camera_driver"] not in (SAME, NONE)),
        Question("peg", "The peg: cross, square, triangle, hexagon, star, spline, keyway, round, or an SVG or DXF file",
                 lambda t, g: of.peg(t), lambda g: "cross"),
        Question("clearance_m", "The hole is larger on every side by, m", _clearance, lambda g: "0.0001"),
        Question("hole_position_m", "Where the hole is: x y z in the base's frame, m", _position,
                 lambda g: _words(default_hole(g).translation_m)),
        Question("hole_axis", "The direction into the hole, in the base's frame", _axis,
                 lambda g: _words(default_hole(g).rotation[:, 2])),
        Question("hole_range_m", "How far it may be from there, m",
                 lambda t, g: of.number(t, 1e-4, 0.1, "metres"), lambda g: "0.01"),
        Question("floor_height_m", "The height of the floor or table over the base's origin, m, or none",
                 lambda t, g: of.or_none(t, -3.0, 3.0, "metres"), lambda g: "0.05" if not real(g) else "0"),
        Question("force_cap_n", "The force at which the arm backs off, N",
                 lambda t, g: of.number(t, 5.0, 500.0, "newtons"), lambda g: "60"),
        Question("moved_mass_kg", "What of arm and tool moves with the tip, kg; none: the driver knows, or strict",
                 lambda t, g: of.or_none(t, 0.1, 200.0, "kg"), lambda g: NONE, real),
        Question("contact_stiffness_n_m", "The stiffness of peg against plate, N/m; none: the driver knows, or strict",
                 lambda t, g: of.or_none(t, 2e3, 1e9, "N/m"), lambda g: NONE, real),
    ]  # fmt: skip
