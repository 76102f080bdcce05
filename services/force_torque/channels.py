"""Checks single channels in a calibration's readings: copies, stuck or clipped channels, drift, and noise.

A model that is linear in its parameters fits values (n, 3), three channels in n poses, by a design (n, 3, k).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array

_ALIKE = 1e-3  # of the residuals' limit: readings of a clipped channel agree within it
_BETTER = 0.35
_SURE = 8.0
_NOISY = 10.0


@dataclass(frozen=True, slots=True)
class Channels:
    """Three channels that are fitted together: their names, their unit, the limit of their residuals, and the sensor's
    range."""

    names: tuple[str, str, str]
    unit: str
    limit: float
    range: float


def first_of_copies(rotations: Array, wrenches: Array) -> list[int]:
    """Indices of poses that are no copies of an earlier one: the same reading (n, 6), to the last digits, at the same
    orientation (n, 3, 3)."""
    kept: list[int] = []
    for index in range(len(wrenches)):
        copied = any(
            np.max(np.abs(wrenches[index] - wrenches[other])) < 1e-9
            and np.max(np.abs(rotations[index] - rotations[other])) < 1e-6
            for other in kept
        )
        if not copied:
            kept.append(index)
    return kept


def stuck(values: Array, channels: Channels) -> str | None:
    """A channel with the same value in all poses while the others follow the load; None if there is none."""
    spread = np.ptp(values, axis=0)
    for axis, name in enumerate(channels.names):
        if spread[axis] == 0.0 and np.max(spread) > channels.limit:
            return (
                f"{name} is {values[0, axis]:.4g} {channels.unit} in all poses while the other channels follow the "
                "load: this channel is stuck; see the sensor's cable and its driver"
            )
    return None


def clipped(design: Array, values: Array, channels: Channels) -> str | None:
    """A channel that stops at one value in two or more poses where the other readings predict a larger one; else
    None."""
    solution = np.linalg.lstsq(design.reshape(-1, design.shape[2]), values.ravel(), rcond=None)[0]
    rms = _rms(values - design @ solution)
    for axis, name in enumerate(channels.names):
        for side in (1.0, -1.0):
            told = side * values[:, axis]
            at_stop = told > np.max(told) - _ALIKE * channels.limit
            if np.count_nonzero(at_stop) < 2 and np.max(told) < 0.98 * channels.range:
                continue
            kept = np.ones(values.shape, dtype=bool)
            kept[at_stop, axis] = False
            if np.count_nonzero(kept) < design.shape[2] or np.linalg.cond(design[kept]) > 1e3:
                continue
            without = np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
            after = _rms((values - design @ without)[kept])
            beyond = side * (design[at_stop, axis] @ without) - told[at_stop]
            if np.min(beyond) > max(0.1 * channels.limit, 5.0 * after) and after < _BETTER * rms:
                poses = ", ".join(str(index + 1) for index in np.flatnonzero(at_stop))
                return (
                    f"{name} stops at {side * float(np.max(told)):.4g} {channels.unit} in the poses {poses}, where "
                    f"the other readings want up to {float(np.max(beyond)):.3g} {channels.unit} more: the channel is "
                    "clipped; see the sensor's range in its driver, and the bias it is set to"
                )
    return None


def drift(design: Array, values: Array, channels: Channels) -> tuple[str, float] | None:
    """A channel that drifts steadily from the first pose to the last: in words, and by how much; None if there is
    none."""
    count, size = len(values), design.shape[2]
    if 3 * count - size - 3 < 3:
        return None
    time = np.linspace(-0.5, 0.5, count)
    moving = np.concatenate([design, time[:, None, None] * np.eye(3)[None]], axis=2)
    flat = moving.reshape(3 * count, size + 3)
    if np.linalg.cond(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-12)) > 1e3:
        return None
    before = np.linalg.lstsq(design.reshape(-1, size), values.ravel(), rcond=None)[0]
    after = np.linalg.lstsq(flat, values.ravel(), rcond=None)[0]
    left, rms = values - moving @ after, _rms(values - design @ before)
    variance = float(np.sum(left**2)) / (3 * count - size - 3)
    sd = np.sqrt(np.maximum(np.diag(variance * np.linalg.inv(flat.T @ flat))[-3:], 1e-18))
    axis = int(np.argmax(np.abs(after[-3:])))
    moved = float(after[-3:][axis])
    if abs(moved) < 0.2 * channels.limit or abs(moved) < _SURE * sd[axis] or _rms(left) > _BETTER * rms:
        return None
    said = (
        f"{channels.names[axis]} drifts by {moved:+.3g} {channels.unit} from the first pose to the last: let the "
        "sensor warm up, and see its cable; then calibrate again"
    )
    return said, abs(moved)


def beyond_noise(residuals: Array, sd: Array | None, channels: Channels) -> str | None:
    """Residuals (n, 3) far above the readings' own standard deviations (n, 3), in words; None if they are not, or if
    the standard deviations are not known."""
    if sd is None or not np.max(sd) > 0.0:
        return None
    rms, noise = _rms(residuals), _rms(sd)
    if rms < 0.05 * channels.limit or rms < _NOISY * noise:
        return None
    return (
        f"the residuals, {rms:.3g} {channels.unit}, are {rms / noise:.0f} times what the readings' noise explains: "
        "something is loose, touches or pulls (a cable, the peg in its holder), or the sensor is not linear; look "
        "before you rely on it"
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
