"""For a narrow window, such as a phone's: the panel below the 3-D view instead of over it, and the whole
cell in view.
"""

from __future__ import annotations

from math import atan, tan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser

FOV_RAD = 0.75  # vertical field of view in a window that is wide enough
WIDE_ENOUGH = 0.72  # width over height of a window in which the cell fits with FOV_RAD
WIDEST_RAD = 1.3  # a wider angle would distort the picture
STEP_RAD = 0.01

# viser's own panel for phones lies over the view, 20em wide at its right edge. Its parts have no class names: they are
# found by viser's inline styles. In a browser without :has() the panel stays as it is.
STYLE = """<style>@media (max-width: 36em) {
  :has(> [style*="max-height: 60%"][style*="width: 20em"]) { flex-direction: column !important; }
  :has(> [style*="max-height: 60%"][style*="width: 20em"]) > :has(canvas) { min-height: 0; }
  :has(canvas) ~ [style*="max-height: 60%"][style*="width: 20em"] {
    position: relative !important; width: 100% !important; max-height: 52% !important; flex: none;
  }
  [style*="max-height: 60%"] [style*="width: 20em"] { width: 100vw !important; }
}</style>"""


def upright_fov_rad(aspect: float) -> float:
    """The vertical angle of view in which as much fits horizontally as in a window that is wide enough.

    `aspect` is the window's width over its height.
    """
    if aspect >= WIDE_ENOUGH:
        return FOV_RAD
    return min(2.0 * atan(tan(FOV_RAD / 2.0) * WIDE_ENOUGH / max(aspect, 1e-3)), WIDEST_RAD)


def keep_in_view(server: viser.ViserServer) -> None:
    """Widen the angle of view of clients with a narrow window, also when it is turned or the panel folded."""

    @server.on_client_connect
    def _(client: viser.ClientHandle) -> None:
        def fit(camera: viser.CameraHandle) -> None:
            wanted = upright_fov_rad(camera.aspect)
            if abs(camera.fov - wanted) > STEP_RAD:
                camera.fov = wanted

        client.camera.on_update(fit)
        fit(client.camera)
