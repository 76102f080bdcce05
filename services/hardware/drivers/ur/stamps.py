"""The controller's timestamps as the cell's clock: this machine's monotonic one, smoothly."""

from __future__ import annotations

from services.hardware.device_clock import DeviceClock

_SLEW = 0.01  # of the time that went by: how fast a stamp follows a better estimate
_STEP_S = 0.5  # a gap after which the time is taken anew


class Stamps:
    """Gives each package a time, ns, that always goes on; a better estimate of the clock is come to gradually."""

    def __init__(self) -> None:
        self._clock = DeviceClock()
        self._last_ns = 0
        self._last_s: float | None = None

    @property
    def uncertainty_s(self) -> float:
        """Of the mapping."""
        return self._clock.uncertainty_s

    def observe(self, device_s: float, host_ns: int) -> None:
        """A package that has just come."""
        self._clock.observe(device_s, host_ns)

    def to_ns(self, device_s: float) -> int:
        """When a package was measured. Call in their order, each after it was observed or with one that was."""
        wanted_ns = self._clock.to_host_ns(device_s)
        went_s = 0.0 if self._last_s is None else device_s - self._last_s
        if self._last_s is None or not 0.0 <= went_s <= _STEP_S:
            stamp_ns = max(wanted_ns, self._last_ns + 1)
        else:
            straight_ns = self._last_ns + round(went_s * 1e9)
            most_ns = round(went_s * _SLEW * 1e9)
            stamp_ns = straight_ns + min(most_ns, max(-most_ns, wanted_ns - straight_ns))
        self._last_ns, self._last_s = stamp_ns, device_s
        return stamp_ns
