"""The page's panels for one cell: headline, charts, section, pictures, estimate, services."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Image
from crosspih_common.shapes import Peg
from services.viewer import words
from services.viewer.charts import GROUPS, TOUCH_COLOUR, Chart
from services.viewer.section_picture import section_svg
from services.viewer.timeline import SceneMoment, StampedPicture

if TYPE_CHECKING:
    import viser

COLOURS = ("#e03131", "#2f9e44", "#1c7ed6")
CHART_PX = 190
WIDEST_PX = 640


class Headline:
    """The phase and the outcome."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._html = _Html(server)

    def show(self, moment: SceneMoment, before: str = "") -> None:
        """Show a moment."""
        self._html.say(before + words.headline(moment) + words.warnings(moment))


class ForcePanel:
    """Forces and moments against time, and the section with the touching arms."""

    def __init__(self, server: viser.ViserServer, peg: Peg) -> None:
        self._peg = peg
        self._shades = _Html(server)
        self._force = _chart(server, ("Fx", "Fy", "Fz"), "N")
        self._moment = _chart(server, ("Mx", "My", "Mz"), "Nm")
        self._section = _Html(server)
        self._contact = _Html(server)
        self._belief = _Html(server)

    def show(self, moment: SceneMoment, chart: Chart | None) -> None:
        """Show a moment; without a new chart the charts stay as they are."""
        contact = moment.contact if moment.in_contact else None
        self._section.say(section_svg(self._peg, contact, moment.wrench if moment.in_contact else None))
        self._contact.say(words.contact(moment))
        self._belief.say(words.estimate(moment))
        if chart is None:
            return
        self._shades.say(words.shades(moment))
        for handle, lines in ((self._force, chart.forces_n), (self._moment, chart.moments_nm)):
            handle.data = (chart.times_s, *chart.shades, *lines)


class PicturePanel:
    """Both pictures; with vision's findings drawn in, where there are some."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._handles: dict[str, Any] = {}
        self._shown: dict[str, tuple[bool, int]] = {}
        self._none = _Html(server)
        self._none.say('<div class="cp dim">no picture has been taken</div>')
        empty = np.zeros((2, 2, 3), np.uint8)
        for name in ("left", "right"):
            self._handles[name] = server.gui.add_image(empty, label=f"{name} camera", jpeg_quality=80, visible=False)

    def show(self, moment: SceneMoment) -> list[tuple[str, Array | None]]:
        """Show a moment. Returns the pictures that changed, for other displays; None stands for no picture any more."""
        changed: list[tuple[str, Array | None]] = []
        for name, handle in self._handles.items():
            picture, annotated = newest(moment, name)
            now = (annotated, -1 if picture is None else picture.stamp_ns)
            if self._shown.get(name) == now:
                continue
            self._shown[name] = now
            pixels = None if picture is None else rgb(picture.load())
            if pixels is not None:
                handle.image = pixels
            handle.label = f"{name} camera" + (", with what vision found" if annotated else "")
            handle.visible = pixels is not None
            changed.append((name, pixels))
        if changed:
            self._none.visible(not any(stamp >= 0 for _, stamp in self._shown.values()))
        return changed


class Services:
    """The state of the services."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._html = _Html(server)

    def show(self, moment: SceneMoment, alive: frozenset[str] | None) -> None:
        """Show a moment; `alive` are the running services, where that is known."""
        self._html.say(words.services(moment, alive))


def newest(moment: SceneMoment, camera: str) -> tuple[StampedPicture | None, bool]:
    """The picture of a camera to show, and whether vision's findings are drawn into it."""
    raw, drawn = moment.pictures.get(camera), moment.pictures.get(f"annotated {camera}")
    if drawn is not None and (raw is None or drawn.stamp_ns >= raw.stamp_ns):
        return drawn, True
    return raw, False


def rgb(image: Image) -> Array:
    """The picture as (height, width, 3) uint8, no wider than WIDEST_PX."""
    pixels = np.asarray(image.pixels)
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    elif image.encoding == "bgr8":
        pixels = pixels[:, :, ::-1]
    step = -(-pixels.shape[1] // WIDEST_PX)
    return np.ascontiguousarray(pixels[::step, ::step])


class _Html:
    """A piece of HTML that is sent when it changes."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._handle = server.gui.add_html("")
        self._said = ""

    def say(self, text: str) -> None:
        if text != self._said:
            self._handle.content = self._said = text

    def visible(self, shown: bool) -> None:
        self._handle.visible = shown


def _chart(server: viser.ViserServer, names: tuple[str, str, str], unit: str) -> Any:
    flat = {"scale": "share", "width": 0, "points": {"show": False}, "class": "shade"}
    series: list[Any] = [{"label": "time, s"}]
    series += [{**flat, "label": name, "fill": f"{colour}2e"} for name, colour, _ in GROUPS]
    series += [{**flat, "label": "touch", "fill": TOUCH_COLOUR}, {**flat, "label": "now", "fill": "#868e96dd"}]
    series += [
        {"label": f"{name} {unit}", "scale": "y", "stroke": colour, "width": 1.4, "points": {"show": False}}
        for name, colour in zip(names, COLOURS, strict=True)
    ]
    nothing = tuple(np.array([0.0, 1.0]) if not index else np.zeros(2) for index in range(len(series)))
    axis: Any = {
        "scale": "y",
        "size": 44,
        "ticks": {"size": 5},
        "gap": 3,
        "label": unit,
        "labelSize": 16,
        "labelFont": "11px sans-serif",
    }
    return server.gui.add_uplot(
        nothing, tuple(series), height=CHART_PX, padding=(8, 12, 0, 0),
        scales={"x": {"time": False}, "y": {"auto": True}, "share": {"auto": False, "range": (0.0, 1.0)}},
        axes=({"size": 30, "ticks": {"size": 5}, "gap": 3}, axis),
        legend={"show": True, "live": True}, cursor={"drag": {"x": True, "y": False}},
    )  # fmt: skip


def within(container: Any | None) -> AbstractContextManager[Any]:
    """The container to put things in, or the main panel."""
    return nullcontext() if container is None else container
