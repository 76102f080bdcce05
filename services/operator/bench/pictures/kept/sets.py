"""Which pictures there are: groups of scenes that are rendered, and rows of the table: groups seen by a camera.

One render serves many rows: a row's sensor and lens are put on when a pair is loaded.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from services.operator.bench.pictures.camera.cameras import Pair, bent, cell_pair, resized, toed_in
from services.operator.bench.pictures.camera.sensor import Sensor
from services.operator.bench.pictures.scenes.finishes import FINISHES
from services.operator.bench.pictures.scenes.scene import HOLE, SceneSpec
from services.operator.bench.pictures.tracing.rendering import Care

Rng = np.random.Generator
OUTLINES = ("square", "triangle", "hexagon", "star", "spline", "keyway", "round", "ell", "tee")
STRONG = (-0.3, 0.12, 0.0005, -0.0004)
USUAL_CARE = Care()
USUAL_SENSOR = Sensor()
PLAIN = ("matt", "painted", "plastic")


def _of(rng: Rng, choices: tuple[str, ...]) -> str:
    return str(rng.choice(np.array(choices)))


def _matt(rng: Rng, index: int) -> SceneSpec:
    return SceneSpec(PLAIN[index % 3], _of(rng, ("soft", "soft", "soft", "dome", "box")))


def _metal_soft(rng: Rng, index: int) -> SceneSpec:
    return SceneSpec(FINISHES[index % 5], "box" if index % 2 else "dome", _of(rng, ("dark", "dark", "clutter")))


def _metal_hard(rng: Rng, index: int) -> SceneSpec:
    return SceneSpec(FINISHES[index % 5], ("strip", "ring", "side")[index % 3])


def _lamp(rng: Rng, index: int) -> SceneSpec:
    return SceneSpec(PLAIN[index % 3], _of(rng, ("side", "lamp", "ring")), _of(rng, ("dark", "clutter")))


def _black(rng: Rng, index: int) -> SceneSpec:
    light, background = _of(rng, ("box", "soft", "dome", "ring")), ("dark", "clutter", "bright")[index % 3]
    return SceneSpec("anodised" if index % 2 else "black", light, background)


def _bright(rng: Rng, index: int) -> SceneSpec:
    surface = _of(rng, (*PLAIN, *FINISHES, "anodised"))
    return SceneSpec(surface, _of(rng, ("soft", "box", "dome")), "half" if index % 2 else "bright", through=True)


def _through(rng: Rng, index: int) -> SceneSpec:
    surface = _of(rng, (*PLAIN, *FINISHES))
    return SceneSpec(surface, _of(rng, ("soft", "box", "dome")), "clutter" if index % 2 else "dark", through=True)


def _blind(rng: Rng, index: int) -> SceneSpec:
    surface = _of(rng, (*PLAIN, *FINISHES))
    walls = "dark" if index % 2 else "lit"
    return SceneSpec(surface, _of(rng, ("soft", "box", "dome")), through=False, walls=walls)


def _clutter(rng: Rng, index: int) -> SceneSpec:
    surface = _of(rng, FINISHES if index % 3 else PLAIN)
    return SceneSpec(surface, _of(rng, ("box", "dome", "soft")), "clutter", clutter=True)


def _covered(rng: Rng, index: int) -> SceneSpec:
    surface = _of(rng, FINISHES if index % 2 else PLAIN)
    return SceneSpec(surface, _of(rng, ("soft", "box", "dome")), cover=("bar", "cable", "peg")[index % 3])


def _outlines(rng: Rng, index: int) -> SceneSpec:
    outline = OUTLINES[index % len(OUTLINES)]
    surface = _of(rng, FINISHES if index // len(OUTLINES) % 2 else PLAIN)
    return SceneSpec(surface, _of(rng, ("soft", "box", "dome")), outline=outline)


def _any_soft(rng: Rng, index: int) -> SceneSpec:
    return _metal_soft(rng, index // 2) if index % 2 else _matt(rng, index // 2)


def _without(*targets: str) -> Callable[[Rng, int], SceneSpec]:
    """Scenes without the hole."""

    def draw(rng: Rng, index: int) -> SceneSpec:
        target = targets[index % len(targets)]
        ink = target.startswith("print") or target == "sticker"
        surface = _of(rng, ("paper", "paper", *PLAIN, *FINISHES) if ink else (*PLAIN, *FINISHES))
        light = _of(rng, ("soft", "box", "dome", "side"))
        clutter = target == "blank" and index % 2 == 0
        return SceneSpec(surface, light, _of(rng, ("dark", "clutter")), target=target, clutter=clutter)

    return draw


@dataclass(frozen=True, slots=True)
class Group:
    """Scenes that are rendered alike: `draw(rng, index)` says what, `rig` by which cameras, `care` how finely."""

    draw: Callable[[Rng, int], SceneSpec]
    rig: Callable[[Rng], Pair] = field(default=lambda rng: cell_pair())
    care: Care = USUAL_CARE


GROUPS: dict[str, Group] = {
    "matt": Group(_matt),
    "metal_soft": Group(_metal_soft),
    "metal_hard": Group(_metal_hard),
    "lamp": Group(_lamp),
    "black": Group(_black),
    "bright": Group(_bright),
    "through": Group(_through),
    "blind": Group(_blind),
    "clutter": Group(_clutter),
    "covered": Group(_covered),
    "outlines": Group(_outlines),
    "turned": Group(_any_soft, lambda rng: toed_in(cell_pair(), rng)),
    "wide": Group(_any_soft, lambda rng: bent(cell_pair(), "plumb_bob", STRONG)),
    "fine": Group(_any_soft, care=Care(4, 25)),
    "print_inner": Group(_without("print_inner")),
    "print_outer": Group(_without("print_outer")),
    "print_shaded": Group(_without("print_shaded")),
    "sticker": Group(_without("sticker")),
    "pocket": Group(_without("pocket")),
    "blank": Group(_without("blank")),
    "other": Group(_without("square", "round", "slot")),
    "other_cross": Group(_without("wide_cross", "long_cross", "short_cross", "plus_one")),
}


@dataclass(frozen=True, slots=True)
class PictureRow:
    """One row of the table: the groups whose scenes it takes in turn, and the camera that sees them.

    `pairs` is how many of them in a set of usual size. `lens` bends or resizes the group's own cameras. `told`: whether
    the calibration says the distortion. `swapped`: left and right by mistake, so that there is no such hole.
    """

    groups: tuple[str, ...]
    pairs: int
    sensor: Sensor = USUAL_SENSOR
    lens: Callable[[Pair], Pair] = field(default=lambda pair: pair)
    told: bool = True
    swapped: bool = False
    gamma_told: str | None = None


def _k1(k1: float) -> Callable[[Pair], Pair]:
    """A lens with barrel distortion; a strong one bends back at the border, as lenses do."""
    k2 = 1.33 * k1 * k1
    return lambda pair: bent(pair, "plumb_bob", (k1, k2, 0.0, 0.0), (k1 * 1.03, k2, 0.0, 0.0))


def _sized(factor: float, width: int, height: int) -> Callable[[Pair], Pair]:
    return lambda pair: resized(pair, factor, (width, height))


USUAL = ("matt", "metal_soft")
ROWS: dict[str, PictureRow] = {
    "matt": PictureRow(("matt",), 16),
    "metal_soft": PictureRow(("metal_soft",), 20),
    "metal_hard": PictureRow(("metal_hard",), 15),
    "lamp": PictureRow(("lamp",), 6),
    "black": PictureRow(("black",), 9),
    "bright": PictureRow(("bright",), 10),
    "through": PictureRow(("through",), 6),
    "blind": PictureRow(("blind",), 6),
    "clutter": PictureRow(("clutter",), 12),
    "covered": PictureRow(("covered",), 9),
    "outlines": PictureRow(("outlines",), 18),
    "blur_0.3": PictureRow(USUAL, 8, Sensor(blur_px=0.3)),
    "blur_0.5": PictureRow(USUAL, 8, Sensor(blur_px=0.5)),
    "blur_0.9": PictureRow(USUAL, 8, Sensor(blur_px=0.9)),
    "blur_1.2": PictureRow(USUAL, 8, Sensor(blur_px=1.2)),
    "blur_1.5": PictureRow(USUAL, 8, Sensor(blur_px=1.5)),
    "motion_3": PictureRow(USUAL, 8, Sensor(motion_px=3.0)),
    "noise_0.3": PictureRow(USUAL, 8, Sensor(noise_grey=0.3)),
    "noise_6": PictureRow(USUAL, 8, Sensor(noise_grey=6.0)),
    "shot": PictureRow(USUAL, 8, Sensor(noise_grey=0.6, full_well_e=5000.0)),
    "srgb": PictureRow(USUAL, 8, Sensor(noise_grey=0.5, full_well_e=9000.0, gamma="srgb"), gamma_told="srgb"),
    "srgb_untold": PictureRow(USUAL, 6, Sensor(noise_grey=0.5, full_well_e=9000.0, gamma="srgb")),
    "k1_-0.05": PictureRow(USUAL, 6, lens=_k1(-0.05)),
    "k1_-0.1": PictureRow(USUAL, 6, lens=_k1(-0.1)),
    "k1_-0.3": PictureRow(("wide",), 6, lens=lambda pair: pair),
    "k1_-0.02_untold": PictureRow(USUAL, 6, lens=_k1(-0.02), told=False),
    "k1_-0.05_untold": PictureRow(USUAL, 6, lens=_k1(-0.05), told=False),
    "turned": PictureRow(("turned",), 6),
    "320x240": PictureRow(USUAL, 6, lens=_sized(0.5, 320, 240)),
    # by the makers' sheets and EMVA 1288 reports, rounded: size, electrons at full scale, read noise of 255 grey
    "imx273": PictureRow(("fine",), 4, Sensor(0.55, 0.06, 0.0, 10500.0, bits=12), _sized(2.25, 1440, 1080)),
    "imx250": PictureRow(("fine",), 4, Sensor(0.6, 0.06, 0.0, 10500.0, bits=12), _sized(3.825, 2448, 2048)),
    "ov9281": PictureRow(("fine",), 4, Sensor(0.8, 0.35, 0.0, 7500.0, bits=10, vignetting=0.3), _sized(1.6, 1280, 800)),
    "mt9v034": PictureRow(USUAL, 6, Sensor(0.5, 0.5, 0.0, 20000.0, bits=10, vignetting=0.2), _sized(1.175, 752, 480)),
    "print_inner": PictureRow(("print_inner",), 16),
    "print_outer": PictureRow(("print_outer",), 16),
    "print_shaded": PictureRow(("print_shaded",), 14),
    "sticker": PictureRow(("sticker",), 10),
    "pocket": PictureRow(("pocket",), 16),
    "blank": PictureRow(("blank",), 8),
    "other": PictureRow(("other",), 9),
    "other_cross": PictureRow(("other_cross",), 16),
    "mirrored": PictureRow(USUAL, 10, swapped=True),
}
NAMED_SEEDS = {"dev": 100, "held": 7000}
"""Pictures to develop on, those of `tests/pictures/set` among them, and others to judge by what was developed."""


@dataclass(frozen=True, slots=True)
class SceneName:
    """One scene of a group, under a set's seed."""

    group: str
    index: int
    set_seed: int

    @property
    def seed(self) -> int:
        """The scene's own seed: no two groups share one."""
        return (zlib.crc32(self.group.encode()) % 9000) * 100_000 + self.set_seed + self.index

    @property
    def file(self) -> str:
        """Its file in the store."""
        return f"{self.group}_{self.set_seed + self.index}.npz"

    def drawn(self) -> tuple[SceneSpec, Pair, Care]:
        """What is rendered, by which cameras, how finely. Bent metal needs more samples than paint."""
        group = GROUPS[self.group]
        rng = np.random.default_rng([self.seed, 22])
        spec, pair = group.draw(rng, self.index), group.rig(rng)
        care = group.care
        if spec.target != HOLE:
            care = replace(care, samples=16)
        elif spec.surface in FINISHES and care.density == USUAL_CARE.density:
            care = replace(care, samples=49)
        return spec, pair, care


def scene_of(row: PictureRow, index: int, set_seed: int) -> SceneName:
    """The scene of a row's pair: its groups in turn."""
    return SceneName(row.groups[index % len(row.groups)], index // len(row.groups), set_seed)


def pairs_of(name: str, share: float) -> int:
    """How many pairs a row has in a set of a share of the usual size, one at least."""
    return max(1, round(ROWS[name].pairs * share))
