"""The text of a calibration file as mappings: YAML, JSON, and OpenCV's FileStorage in either form."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from crosspih_common.errors import CrosspihError
from crosspih_common.geometry.pose import Array


class CameraFileError(CrosspihError):
    """A calibration file that cannot be used; the text names file, field and remedy."""


class _Loader(yaml.SafeLoader):
    """SafeLoader that reads OpenCV's matrices as mappings."""


def _matrix(loader: yaml.SafeLoader, suffix: str, node: yaml.Node) -> Any:
    return loader.construct_mapping(node, deep=True) if isinstance(node, yaml.MappingNode) else None


_Loader.add_multi_constructor("tag:yaml.org,2002:opencv-", _matrix)


def documents(path: Path) -> list[dict[str, Any]]:
    """Every document of a file, each a mapping. Raises CalibrationFileError."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise CameraFileError(f"calibration: {path} cannot be read ({error.strerror}); give a file") from None
    except UnicodeDecodeError:
        raise CameraFileError(f"calibration: {path} is no text; give YAML or JSON") from None
    if text.startswith("%YAML:1.0"):  # OpenCV writes this, but it is not valid YAML
        text = text.split("\n", 1)[1] if "\n" in text else ""
    try:
        found = [json.loads(text)] if text.lstrip().startswith("{") else list(yaml.load_all(text, _Loader))
    except (yaml.YAMLError, ValueError) as error:
        told = " ".join(str(error).split())
        raise CameraFileError(f"calibration: {path} is neither YAML nor JSON: {told[:200]}") from None
    found = [document for document in found if document is not None]
    if not found or not all(isinstance(document, dict) for document in found):
        raise CameraFileError(f"calibration: {path} holds no fields; docs/locate.md lists the formats")
    return found


def numbers(value: Any, field: str, *shapes: tuple[int, ...]) -> Array:
    """The numbers of a field, from a list, nested lists or a mapping with `data`, in the first of the shapes that has
    the same count; without shapes any flat list. Raises CalibrationFileError naming the field.
    """
    given = value.get("data") if isinstance(value, dict) else value
    try:
        flat = np.array(given, dtype=float).ravel()
    except (TypeError, ValueError):
        raise CameraFileError(f"calibration: {field} is not a list of numbers") from None
    if not np.isfinite(flat).all():
        raise CameraFileError(f"calibration: {field} holds a value that is not a finite number: {flat.tolist()}")
    for shape in shapes:
        if int(np.prod(shape)) == flat.size:
            return flat.reshape(shape)
    if shapes:
        wanted = " or ".join(str(int(np.prod(shape))) for shape in shapes)
        raise CameraFileError(f"calibration: {field} has {flat.size} numbers; give {wanted}")
    return flat


def whole(value: Any, field: str) -> int:
    """A size in pixels. Raises CalibrationFileError naming the field."""
    try:
        number = int(value)
    except (TypeError, ValueError):
        number = 0
    if number <= 0:
        raise CameraFileError(f"calibration: {field} is {value!r}; give a whole number above 0, px")
    return number
