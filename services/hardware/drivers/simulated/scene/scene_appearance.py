"""How the cell looks in one shot: the ordinary variation drawn per seed, and the faults that a test can switch on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.config import AppearanceConfig, Background, Finish

# how often each is drawn: a workshop's parts
FINISHES: dict[Finish, float] = {
    "matt": 0.2, "milled": 0.2, "ground": 0.2, "turned": 0.15, "cast": 0.1, "blasted": 0.15
}  # fmt: skip
BACKGROUNDS: dict[Background, float] = {"dark": 0.3, "grey": 0.3, "bright": 0.15, "cluttered": 0.25}
# (least, most) of what is drawn: share of the face's grey; how much of the light comes back as from metal
STRENGTHS: dict[Finish, tuple[float, float]] = {
    "matt": (0.0, 0.015), "milled": (0.02, 0.09), "ground": (0.02, 0.08), "turned": (0.02, 0.08), "cast": (0.02, 0.06),
    "blasted": (0.015, 0.06),
}  # fmt: skip
SHINES: dict[Finish, tuple[float, float]] = {
    "matt": (0.0, 0.1), "milled": (0.15, 0.6), "ground": (0.15, 0.6), "turned": (0.15, 0.6), "cast": (0.05, 0.25),
    "blasted": (0.05, 0.35),
}  # fmt: skip
BACKGROUND_GREYS: dict[Background, tuple[float, float]] = {
    "dark": (0.03, 0.12), "grey": (0.2, 0.5), "bright": (0.7, 0.95), "cluttered": (0.1, 0.5)
}  # fmt: skip
FACE_LEVELS = (95.0, 185.0)
"""Grey of a face that looks at the cameras, about."""
FACE_GRADIENTS, PICTURE_GRADIENTS = (0.0, 0.25), (0.0, 0.15)
EDGE_GLINTS, MAX_FACE_GLINTS = (0.0, 100.0), 3
BOTTOM_SHARES = (0.9, 1.0)
"""How deep a blind hole is, of the plate's thickness: a peg that goes as deep as it should does not touch it."""
BLURS_PX, NOISES_GREY = (0.4, 1.2), (0.5, 4.0)
DEFAULT = AppearanceConfig()

NameT = TypeVar("NameT", bound=str)


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """Greys (0..1 of white) and light of one shot; `to_light` is the unit direction (3,) in the base frame.

    gradient: how much brighter the picture's right and lower edge are than its left and upper one. finish,
    finish_strength, shine, edge_glints, face_glints, background: as in `AppearanceConfig`. face_gradient: how much
    brighter the plate's +x and +y side are. marks_seed: of where each mark, glint and thing behind the plate lies.
    bottom_share, bottom_grey: depth of a blind hole as a share of the plate's, or None: through, and its grey.
    chamfer_spread: how far the chamfer scatters what it mirrors, rad. blur_px: of the left and of the right lens. Left
    out, all is plain: matt, without marks, through, before an even background.
    """

    face_grey: float
    bore_grey: float
    background_grey: float
    to_light: Array
    ambient: float
    diffuse: float
    gradient: tuple[float, float]
    finish: Finish = "matt"
    finish_strength: float = 0.0
    shine: float = 0.0
    face_gradient: tuple[float, float] = (0.0, 0.0)
    edge_glints: float = 0.0
    face_glints: int = 0
    background: Background = "dark"
    bottom_share: float | None = None
    bottom_grey: float = 0.3
    chamfer_spread: float = 0.5
    blur_px: tuple[float, float] = (0.7, 0.7)
    noise_grey: float = 3.0
    marks_seed: int = 0
    lamp: int = 0

    @classmethod
    def draw(
        cls, rng: np.random.Generator, config: AppearanceConfig = DEFAULT, depth_m: float | None = None
    ) -> Appearance:
        """A plate with a darker bore as a workshop makes it, lit softly from a random direction on the cameras' side.

        The light reaches into the bore: its walls differ in grey by their direction, as in a real hole. What `config`
        fixes is as it says, and all else is drawn as it would be without. `depth_m` is the plate's, for a bottom whose
        depth is fixed.
        """
        sideways, upwards = rng.uniform(-0.9, 0.9), rng.uniform(-0.3, 1.0)
        to_light = np.array([-1.0, sideways, upwards])
        to_light /= np.linalg.norm(to_light)
        ambient, diffuse = rng.uniform(0.15, 0.3), rng.uniform(0.5, 0.65)
        # whoever set the cell up chose the exposure by the face
        face = min(1.0, rng.uniform(*FACE_LEVELS) / (255.0 * (ambient - diffuse * to_light[0])))
        finish = _one_of(FINISHES, config.finish, rng)
        background = _one_of(BACKGROUNDS, config.background, rng)
        blind = bool(rng.random() < 0.5)
        if config.hole is not None:
            blind = config.hole == "blind"
        bottom = rng.uniform(*BOTTOM_SHARES)
        if config.bottom_depth_m is not None and depth_m is not None:
            bottom = config.bottom_depth_m / depth_m
        bore = face * rng.uniform(0.3, 0.85)
        blur = rng.uniform(*BLURS_PX)
        return cls(
            face_grey=face,
            bore_grey=bore,
            background_grey=rng.uniform(*BACKGROUND_GREYS[background]),
            to_light=to_light,
            ambient=ambient,
            diffuse=diffuse,
            gradient=_towards(rng, config.picture_gradient, PICTURE_GRADIENTS),
            finish=finish,
            finish_strength=_given_or(config.finish_strength, rng, STRENGTHS[finish]),
            shine=_given_or(config.shine, rng, SHINES[finish]),
            face_gradient=_towards(rng, config.face_gradient, FACE_GRADIENTS),
            edge_glints=_given_or(config.edge_glints, rng, EDGE_GLINTS),
            face_glints=_given_or_count(config.face_glints, rng, MAX_FACE_GLINTS),
            background=background,
            bottom_share=bottom if blind else None,
            bottom_grey=bore * rng.uniform(0.2, 0.7),
            chamfer_spread=rng.uniform(0.35, 0.6),
            blur_px=(blur, float(np.clip(blur * rng.uniform(0.9, 1.1), *BLURS_PX))),
            noise_grey=rng.uniform(*NOISES_GREY),
            marks_seed=int(rng.integers(2**31)),
        )

    def under_another_lamp(self, lamp: int) -> Appearance:
        """The same cell with another lamp lit: lamp 1 stands across from lamp 0, 2 as high as 0 is aside, and so on."""
        x, y, z = self.to_light
        turned = {1: (x, -y, -z), 2: (x, z, -y), 3: (x, -z, y)}.get(lamp, (x, 0.0, 0.0))
        return replace(self, to_light=np.array(turned) / np.linalg.norm(turned), lamp=lamp)


def _one_of(shares: Mapping[NameT, float], fixed: NameT | None, rng: np.random.Generator) -> NameT:
    drawn = list(shares)[int(rng.choice(len(shares), p=list(shares.values())))]
    return drawn if fixed is None else fixed


def _given_or(fixed: float | None, rng: np.random.Generator, ends: tuple[float, float]) -> float:
    drawn = float(rng.uniform(*ends))
    return drawn if fixed is None else fixed


def _given_or_count(fixed: int | None, rng: np.random.Generator, most: int) -> int:
    drawn = int(rng.integers(0, most + 1))
    return drawn if fixed is None else fixed


def _towards(rng: np.random.Generator, fixed: float | None, ends: tuple[float, float]) -> tuple[float, float]:
    """A change of that size some way across."""
    size, way = _given_or(fixed, rng, ends), rng.uniform(0.0, 2.0 * np.pi)
    return float(size * np.cos(way)), float(size * np.sin(way))


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
