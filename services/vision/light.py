"""Converts the numbers of a picture to linear light on the sensor, which the fit uses for every camera."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.messages import Gamma
from crosspih_common.messages.images import Pixels

Light = NDArray[np.float32]

FULL = 255.0
# of red, green and blue (ITU-R BT.601), on linear light
GREY = np.array([0.299, 0.587, 0.114], dtype=np.float32)
SENSOR_BITS = (10, 12, 14, 16)
# scale of light (0 to 255) to 16 bit numbers for demosaicing, which works on whole numbers; exact for 8 bit pictures
FINE = 257.0
DEMOSAIC = {
    "rggb": cv2.COLOR_BayerRGGB2GRAY,
    "bggr": cv2.COLOR_BayerBGGR2GRAY,
    "gbrg": cv2.COLOR_BayerGBRG2GRAY,
    "grbg": cv2.COLOR_BayerGRBG2GRAY,
}


def sensor_bits(pixels: Pixels) -> int:
    """The sensor's bits: 8, or for a 16 bit picture the fewest of 10, 12, 14 and 16 that hold its brightest pixel,
    because sensors with fewer bits fill the low ones."""
    if pixels.dtype == np.uint8:
        return 8
    brightest = int(pixels.max(initial=0))
    return next(bits for bits in SENSOR_BITS if brightest < 2**bits)


def undone(share: Light, gamma: Gamma) -> Light:
    """Light (0 to 1) from numbers (0 to 1), with the gamma undone."""
    if gamma is Gamma.LINEAR:
        return share
    low, high = share / 12.92, ((np.maximum(share, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(share <= 0.04045, low, high).astype(np.float32)


def linear_light(pixels: Pixels, encoding: str, gamma: Gamma) -> Light:
    """(height, width) float32, 0 to 255 of full scale, twice the number for twice the light.

    `pixels` (height, width) or (height, width, 3), uint8 or uint16, as `encoding` (crosspih_common.messages.images)
    says; colour becomes grey after its gamma is undone.
    """
    bits = sensor_bits(pixels)
    if bits == 8:
        table = undone(np.arange(256, dtype=np.float32) / np.float32(255.0), gamma) * np.float32(FULL)
        light = table[pixels]
    else:
        light = undone(pixels.astype(np.float32) / np.float32(2**bits - 1), gamma) * np.float32(FULL)
    if encoding.startswith("bayer_"):
        mosaic = np.rint(light * FINE).astype(np.uint16)
        grey = cv2.cvtColor(mosaic, DEMOSAIC[encoding.removeprefix("bayer_")[:4]])
        return np.asarray(grey, dtype=np.float32) / np.float32(FINE)
    if light.ndim == 2:
        return np.asarray(light, dtype=np.float32)
    weights = GREY[::-1] if encoding.startswith("bgr") else GREY
    return np.asarray(light @ weights, dtype=np.float32)


def shown(light: Light, gamma: Gamma) -> NDArray[np.uint8]:
    """The picture for people, (height, width) uint8, with the camera's gamma applied."""
    if gamma is Gamma.LINEAR:
        return np.asarray(np.rint(np.clip(light, 0.0, FULL)), dtype=np.uint8)
    share = np.clip(light / np.float32(FULL), 0.0, 1.0)
    if gamma is Gamma.SRGB:
        share = np.where(share <= 0.0031308, share * 12.92, 1.055 * share ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(share * FULL), dtype=np.uint8)
