"""Reads one answer from text, checks it, or refuses it and says what would be right. Files that it names are read."""

from __future__ import annotations

import ipaddress
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from crosspih_common.arm import NAMED_ARMS
from crosspih_common.config import ArmSection, Workcell
from crosspih_common.config.arm import default_joints
from crosspih_common.config.drawing import OUTLINES, PegDrawing
from crosspih_common.errors import CrosspihError
from crosspih_common.geometry import Pose
from crosspih_common.plain_yaml import text_of_file, yaml_of
from crosspih_common.shapes.importing import FILE_SUFFIXES
from services.operator.locate.calibration_file import FileReading, read_calibration

NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")
HOST = re.compile(r"(?=.{1,253}$)[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?(\.[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?)*")
OWN_DRIVER = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
SAME = "same"
NONE = "none"


class InvalidAnswer(ValueError):
    """An answer that is not valid; the text says what would be right."""


def why(error: Exception) -> str:
    """The first sentence of the message of a model or a reader."""
    if isinstance(error, ValidationError):
        problem = error.errors()[0]
        where = ".".join(str(part) for part in problem["loc"])
        said = str(problem["msg"]).removeprefix("Value error, ")
        return f"{where}: {said}" if where else said
    return str(error)


def text_of(value: Any) -> str:
    """An answer of a file or an option in the form in which a person would type it."""
    if isinstance(value, (list, tuple)):
        return " ".join(text_of(one) for one in value)
    return NONE if value is None else str(value).strip()


def numbers(text: str, count: int, what: str) -> tuple[float, ...]:
    """A given number of finite numbers, separated by commas or blanks."""
    parts = text.replace(",", " ").replace("[", " ").replace("]", " ").split()
    try:
        values = tuple(float(part) for part in parts)
    except ValueError:
        raise InvalidAnswer(f"want {count} numbers: {what}") from None
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise InvalidAnswer(f"want {count} numbers: {what}")
    return values


def number(text: str, least: float, most: float, what: str) -> float:
    """One number in a range."""
    value = numbers(text, 1, what)[0]
    if not least <= value <= most:
        raise InvalidAnswer(f"want {what}, from {least:g} to {most:g}")
    return value


def name(text: str) -> str:
    """The cell's name: the prefix of its keys."""
    if not NAME.fullmatch(text):
        raise InvalidAnswer("want small letters, digits, - and _, at most 32: bench3")
    return text


def file(text: str, what: str) -> Path:
    """A file that exists."""
    path = Path(text).expanduser()
    try:
        there = path.is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    if not there:
        raise InvalidAnswer(f"{text[:80]!r}: there is no such file; want {what}")
    return path


def arm(text: str) -> dict[str, Any]:
    """`cell.arm`: a known arm, a URDF file, or a file with a DH table."""
    if text in NAMED_ARMS:
        return {"name": text}
    if not text.endswith((".urdf", ".yaml", ".yml")):
        raise InvalidAnswer(f"want {', '.join(NAMED_ARMS)}, a .urdf file, or a .yaml file with dh: (docs/arms.md)")
    path = file(text, "a URDF file, or a YAML file with the arm's DH table")
    if path.suffix == ".urdf":
        section: Any = {"urdf": str(path.resolve())}
    else:
        try:
            section = yaml_of(text_of_file(path))
        except (OSError, yaml.YAMLError) as error:
            raise InvalidAnswer(f"{text}: is not YAML: {error}") from None
        if isinstance(section, dict) and set(section) == {"arm"}:
            section = section["arm"]
    try:
        ArmSection.model_validate(section)
    except ValidationError as error:
        raise InvalidAnswer(f"{text}: {why(error)}") from None
    assert isinstance(section, dict)
    return section


def joints_of(section: dict[str, Any]) -> int:
    """The arm's number of joints."""
    return ArmSection.model_validate(section).model().joints


def home(text: str, section: dict[str, Any]) -> tuple[float, ...]:
    """A posture inside the limits, rad."""
    model = ArmSection.model_validate(section).model()
    values = numbers(text, model.joints, f"a posture of the {model.joints} joints, rad, far from everything")
    outside = model.limits.violations(values)
    if outside:
        raise InvalidAnswer("; ".join(outside))
    return values


def default_home(section: dict[str, Any]) -> tuple[float, ...] | None:
    """The home posture of a named arm."""
    return default_joints(section, "home_rad")


def driver(text: str, known: Sequence[dict[str, Any]], device: str) -> str:
    """A driver by its name, or "module:function"."""
    if OWN_DRIVER.fullmatch(text):
        return text
    of = {str(one["name"]): one for one in known if not one["opens"] or device in one["opens"]}
    if text not in of:
        raise InvalidAnswer(
            f"want one of {', '.join(of)}, or your own module:function (crosspih cell drivers lists them)"
        )
    return text


def address(text: str, setting: str) -> str:
    """The address of a device: a host's name or number, a device file, or a file."""
    if setting.endswith((".calibration", ".file")):
        return str(file(text, f"the file of hardware.{setting}").resolve())
    if text.startswith("/dev/") or text.startswith(("http://", "rtsp://")):
        return text
    try:
        ipaddress.ip_address(text)
    except ValueError:
        if re.fullmatch(r"[\d.]+", text) or not HOST.fullmatch(text):
            raise InvalidAnswer("want an address such as 192.168.0.10, a host's name, or a file in /dev") from None
    return text


def calibration(text: str) -> str:
    """The calibration file of the cameras, in any form that `crosspih locate` reads."""
    path = file(text, "the cameras' calibration (docs/locate.md)")
    try:
        read_calibration([path], FileReading(Pose.identity(), sizes=lambda: ((640, 480), (640, 480))))
    except (CrosspihError, ValueError, TypeError) as error:
        raise InvalidAnswer(why(error)) from None
    return str(path.resolve())


def peg(text: str) -> dict[str, Any]:
    """`cell.peg`: an outline by its name, or a drawing's file."""
    drawn = Path(text).suffix.lower() in FILE_SUFFIXES
    if not drawn and text not in OUTLINES:
        raise InvalidAnswer(f"want {', '.join(OUTLINES)}, or an SVG or DXF file (docs/pegs.md)")
    outline = str(file(text, "a drawing").resolve()) if drawn else text
    try:
        Workcell.model_validate({"peg": {"outline": outline}})
    except ValidationError as error:
        raise InvalidAnswer(why(error)) from None
    return PegDrawing(outline=outline).model_dump(exclude_defaults=True) or {"outline": outline}


def choice(text: str, among: Sequence[str]) -> str:
    """One of several words."""
    if text not in among:
        raise InvalidAnswer(f"want {' or '.join(among)}")
    return text


def or_none(text: str, least: float, most: float, what: str) -> float | None:
    """A number, or `none`."""
    return None if text == NONE else number(text, least, most, f"{what}, or none")
