"""The frames of an animation: the arm, the peg and hole in a close view, and the force curves below."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from matplotlib import font_manager, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.recording.plotting import LINES, PHASE_COLOURS
from services.operator.recordings.animating.timing import FrameTime
from services.operator.report.model import Facts
from services.operator.scene3d.bodies import Bodies
from services.operator.scene3d.rasterising import Picture
from services.operator.scene3d.scenes import FORCE, MIN_ARROW_N, Moment, closeup, overview

WIDTH, HEAD, VIEW, STRIP = 880, 34, 330, 176
PAGE, INK, QUIET = (255, 255, 255), (27, 32, 39), (96, 105, 117)
FUTURE = 0.82  # opacity of the veil over the part of the curves that is still to come


class Film:
    """Draws frames of one assembly; `hole` is the plate's pose, `marked` the words that say whose pose it is."""

    def __init__(self, facts: Facts, hole: Pose, marked: str) -> None:
        if facts.joints is None:
            raise ValueError("the recording holds no encoders: there is no motion to show")
        self._facts, self._joints, self._hole = facts, facts.joints, hole
        self._marked = marked
        self._bodies = Bodies.of(facts.workcell)
        self._strip, self._plot = _forces(facts)
        name = font_manager.findfont("DejaVu Sans")
        bold = font_manager.findfont("DejaVu Sans:bold")
        self._small, self._font = ImageFont.truetype(name, 12), ImageFont.truetype(name, 15)
        self._bold = ImageFont.truetype(bold, 15)

    def frames(self, times: list[FrameTime]) -> Iterator[Picture]:
        """Each (height, width, 3), uint8 RGB; a frame that is shown again is drawn once."""
        before: FrameTime | None = None
        picture: Picture | None = None
        for each in times:
            if picture is None or each != before:
                picture, before = self.frame(each), each
            yield picture

    def frame(self, at: FrameTime) -> Picture:
        """One frame."""
        joints, wrench = self._joints.at(at.time_s), self._wrench(at.time_s)
        half = (WIDTH // 2, VIEW)
        canvas = np.full((HEAD + VIEW + STRIP, WIDTH, 3), PAGE, dtype=np.uint8)
        canvas[HEAD : HEAD + VIEW, : half[0]] = overview(self._bodies, self._hole, Moment(joints), half)
        near = self._seen(half) if at.looking else None
        if near is None:
            near = closeup(self._bodies, self._hole, Moment(joints, wrench), half)
        canvas[HEAD : HEAD + VIEW, half[0] :] = near
        canvas[HEAD + VIEW :] = self._run_to(at.time_s)
        return self._said(canvas, at, wrench)

    def _wrench(self, time_s: float) -> Array | None:
        """The load on the peg; None in free air, where the measured load is inertia."""
        trace = self._facts.forces.filtered or self._facts.forces.unfiltered
        if trace is None or any(start <= time_s <= end for start, end in self._facts.forces.free_spans):
            return None
        return np.array([np.interp(time_s, trace.time_s, column) for column in trace.wrench.T])

    def _seen(self, size: tuple[int, int]) -> Picture | None:
        left = self._facts.left
        if left is None or left.pixels.dtype != np.uint8:
            return None
        pixels = left.pixels if left.pixels.ndim == 3 else np.repeat(left.pixels[..., None], 3, axis=2)
        pixels = pixels[..., ::-1] if left.encoding.startswith("bgr") else pixels
        # the middle of it, as wide as the frame
        high = round(pixels.shape[1] * size[1] / size[0])
        top = max(0, (pixels.shape[0] - high) // 2)
        cut = np.ascontiguousarray(pixels[top : top + high])
        return np.asarray(cv2.resize(cut, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def _run_to(self, time_s: float) -> Picture:
        strip = self._strip.copy()
        start_px, end_px, start_s, end_s = self._plot
        share = (time_s - start_s) / max(1e-9, end_s - start_s)
        x = round(start_px + min(1.0, max(0.0, share)) * (end_px - start_px))
        later = strip[20:-26, x : round(end_px)]
        strip[20:-26, x : round(end_px)] = (later * (1.0 - FUTURE) + 255.0 * FUTURE).astype(np.uint8)
        strip[20:-26, max(0, x - 1) : x + 1] = INK
        return strip

    def _said(self, canvas: Picture, at: FrameTime, wrench: Array | None) -> Picture:
        image = Image.fromarray(canvas)
        draw = ImageDraw.Draw(image)
        span = next((span for span in reversed(self._facts.spans) if span.start_s <= at.time_s + 1e-9), None)
        if at.looking:
            looks = [each for each in self._facts.spans if each.message.phase.value == "locating"]
            span = looks[-1] if looks else span
        x = 12.0
        if span is not None:
            name = span.message.phase.value.replace("_", " ")
            colour = PHASE_COLOURS.get(span.message.phase, "#888888")
            wide = draw.textlength(name, font=self._bold)
            draw.rounded_rectangle((x, 6, x + wide + 16, HEAD - 6), 5, fill=colour)
            draw.text((x + 8, HEAD / 2), name, font=self._bold, fill=(16, 18, 22), anchor="lm")
            x += wide + 28
            text = span.message.text
            while len(text) > 1 and draw.textlength(text, font=self._font) > WIDTH - x - 100:
                text = text[:-2].rstrip() + "…"
            draw.text((x, HEAD / 2), text, font=self._font, fill=INK, anchor="lm")
        draw.text((WIDTH - 12, HEAD / 2), f"{at.time_s:.1f} s", font=self._bold, fill=INK, anchor="rm")
        said = f"half of the plate taken away; {self._marked}"
        if at.looking:
            said = "left camera, with the rim that vision fitted"
        tone = (190, 196, 204) if at.looking else QUIET
        draw.text((WIDTH / 2 + 12, HEAD + 8), said, font=self._small, fill=tone, anchor="lt")
        felt_n = 0.0 if wrench is None else float(np.linalg.norm(wrench[:3]))
        if felt_n > MIN_ARROW_N and not at.looking:
            draw.text((WIDTH - 14, HEAD + 28), f"{felt_n:.1f} N", font=self._bold, fill=FORCE, anchor="rt")
        return np.asarray(image)


def _forces(facts: Facts) -> tuple[Picture, tuple[float, float, float, float]]:
    """The curves (STRIP, WIDTH, 3), and where time runs in them: (first pixel, last pixel, first s, last s)."""
    dpi = 100
    start_s, end_s = facts.calibrated_s, max(facts.end_s, facts.calibrated_s + 0.1)
    with rc_context({"font.size": 8.5, "axes.linewidth": 0.6, "font.family": "DejaVu Sans"}):
        figure = Figure(figsize=(WIDTH / dpi, STRIP / dpi), dpi=dpi)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.065, 0.17, 0.92, 0.69))
        for span in facts.spans:
            if span.end_s > span.start_s and span.start_s >= start_s:
                colour = PHASE_COLOURS.get(span.message.phase, "#888888")
                axes.axvspan(span.start_s, span.end_s, color=colour, alpha=0.13, linewidth=0)
        trace = facts.forces.filtered or facts.forces.unfiltered
        if trace is not None:
            for index, (name, colour) in enumerate(zip(("Fx", "Fy", "Fz"), LINES, strict=True)):
                shown = np.where(trace.free, np.nan, trace.wrench[:, index])
                axes.plot(trace.time_s, shown, color=colour, linewidth=1.3, label=name)
                felt = np.where(trace.free, trace.wrench[:, index], np.nan)
                axes.plot(trace.time_s, felt, color=colour, linewidth=0.8, alpha=0.28)
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.98), ncols=3, frameon=False, handlelength=1.3)
        title = "contact force on the peg / N (pale: free air, the tool's inertia)"
        axes.set_title(title, fontsize=8.5, loc="right", pad=5)
        axes.set_xlim(start_s, end_s)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(length=2)
        axes.annotate("s", (1.0, 0.0), (0, -14), "axes fraction", "offset points", ha="right")
        canvas.draw()  # type: ignore[no-untyped-call]
        picture = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        picture = picture[..., :3].copy()
        box = axes.get_position()
    return picture, (box.x0 * WIDTH, box.x1 * WIDTH, start_s, end_s)
