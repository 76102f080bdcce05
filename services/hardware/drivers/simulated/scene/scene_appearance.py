"""How the cell looks in one shot: the ordinary variation drawn per seed, and the faults that a test can switch on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """Greys (0..1 of white) and light of one shot; `to_light` is the unit direction (3,) in the base frame."""

    face_grey: float
    bore_grey: float
    background_grey: float
    to_light: Array
    ambient: float
    diffuse: float
    gradient: tuple[float, float]

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Appearance:
        """A bright machined plate with a darker bore, lit from a random direction on the cameras' side.

        The light reaches into the bore: its walls differ in grey by their direction, as in a real hole.
        """
        sideways, upwards = rng.uniform(-0.9, 0.9), rng.uniform(-0.3, 1.0)
        to_light = np.array([-1.0, sideways, upwards])
        face = rng.uniform(0.7, 1.0)
        return cls(
            face_grey=face,
            bore_grey=face * rng.uniform(0.35, 0.85),
            background_grey=rng.uniform(0.05, 0.2),
            to_light=to_light / np.linalg.norm(to_light),
            ambient=rng.uniform(0.15, 0.3),
            diffuse=rng.uniform(0.5, 0.65),
            gradient=(rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1)),
        )

    def under_another_lamp(self, lamp: int) -> Appearance:
        """The same cell with another lamp lit: lamp 1 stands across from lamp 0, 2 as high as 0 is aside, and so on."""
        x, y, z = self.to_light
        turned = {1: (x, -y, -z), 2: (x, z, -y), 3: (x, -z, y)}.get(lamp, (x, 0.0, 0.0))
        return replace(self, to_light=np.array(turned) / np.linalg.norm(turned))


@dataclass(frozen=True, slots=True)
class Faults:
    """What can go wrong in front of the cameras. The default is a sound picture.

    light_scale: factor on all light (0.05: a dark cell). glare: height in grey levels of a bright round reflection near
    the rim, placed by the seed, in both images. covered_arm: which arm of the cross (0..3 for +x, +y, -x, -y) a flat
    obstacle hides, or None. hole: False draws a blank plate. square: a dark square pocket drawn on the plate.
    second_cross: the same fixture once more beside the first. swapped: left and right images exchanged.
    right_rows_px: rows by which the right picture is off, as of a camera that was knocked.
    """

    light_scale: float = 1.0
    glare: float = 0.0
    covered_arm: int | None = None
    hole: bool = True
    square: bool = False
    second_cross: bool = False
    swapped: bool = False
    right_rows_px: float = 0.0

    def __post_init__(self) -> None:
        if not self.light_scale >= 0.0:
            raise ValueError(f"faults: light_scale is {self.light_scale}, want 0 or more")
        if self.covered_arm not in (None, 0, 1, 2, 3):
            raise ValueError(f"faults: covered_arm is {self.covered_arm}, want 0..3 or none")
