"""Whatever a camera sends becomes the same light: depth, gamma, colour, mosaic."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosspih_common.messages import Gamma
from crosspih_common.messages.images import BAYER
from services.vision.light import linear_light, sensor_bits, shown

RAMP = np.linspace(8.0, 247.0, 60)[None, :] + np.linspace(-6.0, 6.0, 48)[:, None]  # light, 0 to 255


def as_sent(light: Any, depth: int, gamma: Gamma) -> Any:
    share = np.asarray(light) / 255.0
    if gamma is Gamma.SRGB:
        share = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    return np.rint(share * (2**depth - 1)).astype(np.uint8 if depth == 8 else np.uint16)


@pytest.mark.parametrize("gamma", Gamma)
@pytest.mark.parametrize("depth", [8, 10, 12, 16])
def test_mono_of_any_depth_and_gamma_is_the_light(depth: int, gamma: Gamma) -> None:
    sent = as_sent(RAMP, depth, gamma)
    assert sensor_bits(sent) == depth
    light = linear_light(sent, f"mono{8 if depth == 8 else 16}", gamma)
    assert light.dtype == np.float32
    # half a level, and where sRGB is steepest a little more than a whole one
    assert np.abs(light - RAMP).max() < (0.51 if gamma is Gamma.LINEAR else 1.2) * 255.0 / (2**depth - 1)


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_red_and_blue_are_not_exchanged(red: int, green: int, blue: int) -> None:
    rgb = np.array([[[red, green, blue]]], dtype=np.uint8)
    want = 0.299 * red + 0.587 * green + 0.114 * blue
    assert linear_light(rgb, "rgb8", Gamma.LINEAR)[0, 0] == pytest.approx(want, abs=1e-3)
    assert linear_light(rgb[..., ::-1], "bgr8", Gamma.LINEAR)[0, 0] == pytest.approx(want, abs=1e-3)


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("pattern", BAYER)
def test_a_mosaic_of_a_coloured_ramp_is_its_grey_and_stays_where_it_was(pattern: str, depth: int) -> None:
    shares = {"r": 0.9, "g": 0.5, "b": 0.2}
    mosaic = np.empty_like(RAMP)
    for place, colour in enumerate(pattern):
        row, column = divmod(place, 2)
        mosaic[row::2, column::2] = shares[colour] * RAMP[row::2, column::2]
    light = linear_light(as_sent(mosaic, depth, Gamma.LINEAR), f"bayer_{pattern}{depth}", Gamma.LINEAR)
    grey = (0.299 * 0.9 + 0.587 * 0.5 + 0.114 * 0.2) * RAMP
    scale = 1.0 if depth == 8 else 65535.0 / (2 ** sensor_bits(as_sent(mosaic, depth, Gamma.LINEAR)) - 1)
    assert np.abs(light - scale * grey)[1:-1, 1:-1].max() < 0.6


@pytest.mark.parametrize("gamma", Gamma)
def test_what_is_shown_is_what_came(gamma: Gamma) -> None:
    sent = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert np.array_equal(shown(linear_light(sent, "mono8", gamma), gamma), sent)
