"""The sensor's known answers: blur, motion, noise, shot noise, gamma, bits, distortion, and bytes by the seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.operator.bench.pictures.camera.cameras import PictureLens, bent, cell_pair
from services.operator.bench.pictures.camera.sensor import Sensor, expose, seen
from services.operator.bench.pictures.tracing.tracer import FloatImage, LightLevel

LENS = PictureLens(160, 120, 200.0, 200.0, 79.5, 59.5)
CLEAN = Sensor(blur_px=0.0, noise_grey=0.0)


def level(light: FloatImage, density: int = 2) -> LightLevel:
    """Light that fills LENS's picture."""
    rows, columns = light.shape
    return LightLevel(200.0 * density, -columns // 2, -rows // 2, light)


def even(share: float) -> LightLevel:
    return level(np.full((240, 320), share, dtype=np.float32))


def step_at(column: int) -> LightLevel:
    light = np.zeros((240, 320), dtype=np.float32)
    light[:, 2 * column :] = 1.0
    return level(light)


@pytest.mark.parametrize(("blur", "motion"), [(0.3, 0.0), (0.7, 0.0), (1.5, 0.0), (0.7, 3.0)])
def test_a_step_is_blurred_by_gaussian_pixel_and_drag(blur: float, motion: float) -> None:
    row = seen([step_at(80)], LENS, Sensor(blur_px=blur, motion_px=motion), 0.0)[60].astype(float)
    slope = np.diff(row)
    places = np.arange(len(slope)) + 0.5
    middle = float(slope @ places)
    variance = float(slope @ (places - middle) ** 2)
    assert abs(middle - 79.5) < 1e-3  # column 80 begins there
    # differences of pixels are a triangle: it adds E[t (1 - t)], t the place between two pixels, in half pixels here
    k = np.arange(-20, 21)
    weights = np.exp(-0.5 * (k / (2.0 * blur)) ** 2)
    triangle = 0.25 * weights[k % 2 == 1].sum() / weights.sum()
    assert variance == pytest.approx(blur**2 + motion**2 / 12.0 + triangle, abs=0.1 if motion else 0.005)


def test_read_noise_shot_noise_and_gamma() -> None:
    rng = np.random.default_rng(3)
    plain = expose([even(0.5)], LENS, replace(CLEAN, noise_grey=3.0), rng).astype(float)
    assert plain.mean() == pytest.approx(127.5, abs=0.1)
    assert plain.std() == pytest.approx(np.hypot(3.0, 12.0**-0.5), rel=0.02)
    for share in (0.1, 0.6):
        shot = expose([even(share)], LENS, replace(CLEAN, full_well_e=1000.0, bits=12), rng) / 65520.0
        assert shot.std() == pytest.approx(np.sqrt(share / 1000.0), rel=0.03)
    bent_grey = expose([even(0.2140)], LENS, replace(CLEAN, gamma="srgb"), rng)
    assert abs(float(bent_grey.mean()) - 127.5) < 1.0  # IEC 61966-2-1: 0.2140 is half


def test_twelve_bits_fill_the_high_ones_of_sixteen() -> None:
    picture = expose([even(1.0)], LENS, replace(CLEAN, bits=12), np.random.default_rng(0))
    assert picture.dtype == np.uint16
    assert np.all(picture == 4095 * 16)


def test_the_seed_gives_the_bytes() -> None:
    first, again, other = (expose([even(0.5)], LENS, Sensor(), np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("model", ["plumb_bob", "fisheye"])
def test_undistorted_is_the_inverse_and_a_spot_goes_where_the_lens_bends_it(model: str) -> None:
    values = (-0.3, 0.12, 1e-3, -5e-4) if model == "plumb_bob" else (-0.05, 0.01, 0.0, 0.0)
    lens = bent(cell_pair(), model, values).left
    grid = np.stack(np.meshgrid(np.linspace(-0.8, 0.8, 9), np.linspace(-0.6, 0.6, 7)), axis=-1)
    assert np.allclose(lens.undistorted(lens.distorted(grid)), grid, atol=1e-7)
    focal = 2.0 * lens.fx_px
    light = np.zeros((121, 121), dtype=np.float32)
    light[59:62, 59:62] = 1.0
    at = np.array([0.5, -0.3])
    left, top = (int(value) for value in np.floor(at * focal) - 60)
    spot = LightLevel(focal, left, top, light)
    dark = LightLevel(lens.fx_px / 4.0, -200, -150, np.zeros((300, 400), dtype=np.float32))
    picture = seen([dark, spot], lens, Sensor()).astype(float)
    v, u = np.mgrid[: lens.height_px, : lens.width_px]
    found = np.array([np.sum(picture * u), np.sum(picture * v)]) / picture.sum()
    true = (np.array([left, top]) + 60.5) / focal
    assert np.linalg.norm(found - lens.project(np.append(true, 1.0))) < 0.01
