"""Rendered scenes on disk, small: the square root of each level's light in 12 bits or 8, as PNG, one file a scene."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from services.operator.bench.pictures.tracing.tracer import FloatImage, LightLevel

MAX_SHARE = 4.0
"""The brightest light that is kept, as a share of full scale: what is blurred must know how bright it was."""
SMALL_SHARE = 1.5
"""The same in a small file of 8 bits: brighter light is as if it had been so bright, its borders where they were."""


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """One scene: the levels of the left and of the right camera, coarse to fine, and what is known of it."""

    left: tuple[LightLevel, ...]
    right: tuple[LightLevel, ...]
    truth: dict[str, Any]


def save(path: Path, rendered: Rendered, small: bool = False) -> None:
    """Write a scene; the file is there whole or not at all. `small`: in 8 bits, a third of the size."""
    steps, most = (255, SMALL_SHARE) if small else (4095, MAX_SHARE)
    kind = np.uint8 if small else np.uint16
    arrays: dict[str, Any] = {}
    heads = []
    for side, levels in (("left", rendered.left), ("right", rendered.right)):
        for index, level in enumerate(levels):
            key = f"{side}{index}"
            coded = np.rint(np.sqrt(np.clip(level.light / most, 0.0, 1.0)) * steps).astype(kind)
            arrays[key] = np.frombuffer(cv2.imencode(".png", coded, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1], np.uint8)
            heads.append({"side": side, "key": key, "focal_px": level.focal_px, "left": level.left, "top": level.top})
    arrays["about"] = np.frombuffer(
        json.dumps({"steps": steps, "most": most, "levels": heads, "truth": rendered.truth}).encode(), np.uint8
    )
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.savez(file, **arrays)
    part.replace(path)


def truth_of(path: Path) -> dict[str, Any]:
    """What is known of a scene, without its pictures."""
    with np.load(path) as file:
        truth: dict[str, Any] = json.loads(bytes(file["about"]).decode())["truth"]
        return truth


def load(path: Path) -> Rendered:
    """Read a scene."""
    with np.load(path) as file:
        about = json.loads(bytes(file["about"]).decode())
        sides: dict[str, list[LightLevel]] = {"left": [], "right": []}
        for head in about["levels"]:
            coded = np.asarray(cv2.imdecode(file[head["key"]], cv2.IMREAD_UNCHANGED), dtype=np.float32)
            light: FloatImage = np.asarray((coded / about["steps"]) ** 2 * about["most"], dtype=np.float32)
            sides[head["side"]].append(LightLevel(head["focal_px"], head["left"], head["top"], light))
    return Rendered(tuple(sides["left"]), tuple(sides["right"]), about["truth"])
