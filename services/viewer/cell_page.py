"""One cell on the page: its scene and its panels at one moment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from services.viewer.charts import Chart
from services.viewer.narrow import FOV_RAD, keep_in_view
from services.viewer.panels import ForcePanel, Headline, PicturePanel, Services
from services.viewer.scene_view import CellView
from services.viewer.timeline import SceneMoment
from services.viewer.view_points import ViewPoint, view_points

if TYPE_CHECKING:
    import viser

LEFT_PX, RIGHT_PX = 370.0, 330.0


class CellPage:
    """Scene and panels of one cell; `name` distinguishes it from another on the same page, `offset_m` (3,) moves its
    scene.

    The headline goes into the caller's current container; forces, pictures and services become tabs of a panel at the
    left edge.
    """

    def __init__(
        self, server: viser.ViserServer, workcell: Workcell, name: str = "", offset_m: Array | None = None
    ) -> None:
        offset = np.zeros(3) if offset_m is None else offset_m
        self.views: dict[str, ViewPoint] = view_points(workcell, offset)
        self._scene = CellView(server, workcell, f"/{name or 'cell'}", offset)
        self.headline = Headline(server)
        self.panel: Any = server.gui.add_panel()
        with self.panel.add_tab(f"Forces {name}".strip()):
            self._forces = ForcePanel(server, workcell.peg.shape())
        with self.panel.add_tab("Pictures"):
            self._pictures = PicturePanel(server)
        with self.panel.add_tab("Services"):
            self._services = Services(server)
        self.panel.dock_left()
        self.panel.set_width(LEFT_PX)

    def see_through(self, clear: bool) -> None:
        """Show peg and plate as glass, or as they are."""
        self._scene.see_through(clear)

    def move(self, moment: SceneMoment) -> None:
        """Update what moves in the scene."""
        self._scene.show(moment)

    def tell(
        self, moment: SceneMoment, chart: Chart | None, before: str = "", alive: frozenset[str] | None = None
    ) -> None:
        """Update the panels; `alive` are the running services, where that is known."""
        self.headline.show(moment, before)
        self._forces.show(moment, chart)
        self._services.show(moment, alive)
        for camera, pixels in self._pictures.show(moment):
            self._scene.picture(camera, pixels)


def add_glass(server: viser.ViserServer, pages: Sequence[CellPage]) -> None:
    """Add a checkbox that makes peg and plate transparent."""
    box = server.gui.add_checkbox("See through", initial_value=False)

    @box.on_update
    def _(event: object) -> None:
        for page in pages:
            page.see_through(box.value)


def look_from(server: viser.ViserServer, view: ViewPoint) -> None:
    """Set the first view point of whoever opens the page."""
    camera = server.initial_camera
    camera.position, camera.look_at, camera.up = view.eye_m, view.target_m, view.up
    camera.fov = FOV_RAD
    camera.near = 0.005
    keep_in_view(server)


def add_view_buttons(server: viser.ViserServer, views: dict[str, ViewPoint]) -> None:
    """Add buttons that bring the client who presses one to another view point."""
    group = server.gui.add_button_group("Look at", tuple(views))

    @group.on_click
    def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        if event.client is not None:
            view = views[group.value]
            with event.client.atomic():
                event.client.camera.up_direction = view.up
                event.client.camera.position = view.eye_m
                event.client.camera.look_at = view.target_m
