"""Pictures of a report as `data:` addresses: the cameras' pictures, and drawings of arm and peg from the recording."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

import numpy as np
from PIL import Image as PillowImage

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Image, Phase
from services.operator.report.model import Facts
from services.operator.report.model.touches import TouchEntry
from services.operator.report.numbers import number

QUALITY = 82
ARM_SIZE, NEAR_SIZE = (560, 400), (440, 330)
MOST_TOUCHES = 6


@dataclass(frozen=True, slots=True)
class Still:
    """A picture, its caption, and its text for those who cannot see it."""

    address: str
    caption: str
    alt: str


@dataclass(frozen=True, slots=True)
class Stills:
    """The paper's Figures 6, 7, 20 and 21; a picture that cannot be drawn is empty."""

    seen: list[Still]
    driven: list[Still]
    touched: list[Still]
    pressed: list[Still]
    ended: list[Still]


def address_of(pixels: Array | np.ndarray) -> str:
    """A picture (h, w) or (h, w, 3), uint8, as a `data:` address."""
    buffer = io.BytesIO()
    PillowImage.fromarray(np.ascontiguousarray(pixels)).convert("RGB").save(buffer, "WEBP", quality=QUALITY, method=4)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode()


def stills_of(facts: Facts) -> Stills:
    """All of them; without OpenCV 5 only the cameras' pictures."""
    seen = [
        Still(address_of(_eight_bits(image)), f"{side} camera", f"The {side} camera's picture; {_seen_words(facts)}")
        for side, image in (("left", facts.left), ("right", facts.right))
        if image is not None
    ]
    try:
        from services.operator.scene3d import can_draw
    except ImportError:
        return Stills(seen, [], [], [], [])
    if not can_draw() or facts.joints is None:
        return Stills(seen, [], [], [], [])
    return _drawn(facts, seen)


def _seen_words(facts: Facts) -> str:
    figures = facts.figures
    if figures is not None and figures.vision_refused:
        return f"vision refused it: {figures.vision_refused.replace('_', ' ')}."
    return "the rim that vision fitted is drawn into it."


def _eight_bits(image: Image) -> Array:
    pixels = image.pixels
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    return np.asarray(pixels[..., ::-1] if image.encoding.startswith("bgr") else pixels)


def _drawn(facts: Facts, seen: list[Still]) -> Stills:
    from services.operator.scene3d.bodies import Bodies
    from services.operator.scene3d.scenes import Moment, closeup, overview

    joints = facts.joints
    assert joints is not None
    bodies, hole = Bodies.of(facts.workcell), facts.reference

    def arm(time_s: float, caption: str, alt: str) -> Still:
        picture = overview(bodies, hole, Moment(joints.at(time_s)), ARM_SIZE)
        return Still(address_of(picture), f"{caption}, at {number(time_s)} s", alt)

    def near(joints_rad: Array, wrench: Array | None, caption: str, alt: str) -> Still:
        return Still(address_of(closeup(bodies, hole, Moment(joints_rad, wrench), NEAR_SIZE)), caption, alt)

    start_s = facts.calibrated_s
    driven = [arm(start_s, "before", f"The arm at the start, {facts.outline} peg in hand, the plate before it.")]
    arrived = [span.end_s for span in facts.spans if span.message.phase is Phase.APPROACHING]
    if arrived:
        driven.append(arm(arrived[0], "before the hole", "The arm with the peg's tip in front of the hole."))

    def felt(entry: TouchEntry) -> Still:
        touch = entry.touch
        force = number(float(np.linalg.norm(touch.wrench[:3])))
        state = "" if touch.seated else f", {touch.state.case or 'none of the 26 states'}"
        name = f"{'press p' if touch.seated else 'touch '}{entry.number}"
        alt = f"Peg and hole at {name}, half of the plate taken away; the arrow is the force of {force} N on the peg."
        return near(
            np.array(touch.joints_rad), np.array(touch.wrench),
            f"{name}, at {number(entry.time_s)} s: {force} N{state}", alt,
        )  # fmt: skip

    result = facts.window.result
    end = "in its hole" if result is not None and result.inserted else "where it was left"
    at_end = near(joints.at(facts.end_s), None, f"at the end, {number(facts.end_s)} s",
                  f"The peg {end}, half of the plate taken away.")  # fmt: skip
    return Stills(
        seen, driven, [felt(entry) for entry in facts.touches[:MOST_TOUCHES]],
        [felt(entry) for entry in facts.presses[:MOST_TOUCHES]],
        [arm(facts.end_s, "the arm at the end", f"The arm at the end, the peg {end}."), at_end],
    )  # fmt: skip
