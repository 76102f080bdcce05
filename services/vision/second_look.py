"""The lamp and exposure to try after a refusal: under the same light the picture would be refused again."""

from __future__ import annotations

from dataclasses import dataclass

LONGER, SHORTER = 4.0, 0.35
EXPOSURES = (0.05, 32.0)
LAMPS = 4
# refusals that no other light can change: the hole is not there, or the cell's file is wrong
HOPELESS = frozenset({"wrong_image", "cut_off", "two_crosses", "outside_prior", "flat_print", "shallow_pocket"})


@dataclass(frozen=True, slots=True)
class Lighting:
    """How a picture is taken: factor on the usual exposure, and which lamp is lit."""

    exposure_scale: float = 1.0
    lamp: int = 0


def next_look(look: Lighting, refusal_code: str, certain: bool = True) -> Lighting | None:
    """The light to try after a refusal (its code, and whether it is certain); None when light is not what is wrong."""
    if certain and refusal_code in HOPELESS:
        return None
    if refusal_code in ("too_dark", "too_bright"):
        exposure = look.exposure_scale * (LONGER if refusal_code == "too_dark" else SHORTER)
        return Lighting(exposure, look.lamp) if EXPOSURES[0] <= exposure <= EXPOSURES[1] else None
    return Lighting(look.exposure_scale, look.lamp + 1) if look.lamp + 1 < LAMPS else None
