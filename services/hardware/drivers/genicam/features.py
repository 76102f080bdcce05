"""A camera's features by name: what is there, within which limits, set and read back. Errors name feature and mend."""

from __future__ import annotations

import ctypes
from ctypes import byref, c_char_p, c_double, c_int, c_int64, c_uint

from crosspih_common.aravis import POINTER, AravisError, Library
from crosspih_common.errors import ConfigError

FIELD = "hardware.genicam"


class Features:
    """The features of one open camera. Every call may raise AravisError: the camera does not answer."""

    def __init__(self, library: Library, camera: int, who: str) -> None:
        self._library, self._camera, self.who = library, camera, who

    def has(self, name: str) -> bool:
        """Whether the camera has the feature, and it can be used now."""
        call = self._library.checked("arv_camera_is_feature_available", c_int, POINTER, c_char_p)
        return bool(call(self._camera, name.encode()))

    def first_of(self, *names: str) -> str | None:
        """The first of these features that the camera has."""
        return next((name for name in names if self.has(name)), None)

    def text(self, name: str) -> str:
        """A string or the entry of an enumeration."""
        call = self._library.checked("arv_camera_get_string", c_char_p, POINTER, c_char_p)
        return str((call(self._camera, name.encode()) or b"").decode(errors="replace"))

    def integer(self, name: str) -> int:
        """An integer."""
        return int(
            self._library.checked("arv_camera_get_integer", c_int64, POINTER, c_char_p)(self._camera, name.encode())
        )

    def number(self, name: str) -> float:
        """A float."""
        call = self._library.checked("arv_camera_get_float", c_double, POINTER, c_char_p)
        return float(call(self._camera, name.encode()))

    def entries(self, name: str) -> list[str]:
        """What an enumeration may be now."""
        call = self._library.checked(
            "arv_camera_dup_available_enumerations_as_strings",
            ctypes.POINTER(c_char_p), POINTER, c_char_p, ctypes.POINTER(c_uint),
        )  # fmt: skip
        count = c_uint()
        found = call(self._camera, name.encode(), byref(count))
        entries = [(found[index] or b"").decode(errors="replace") for index in range(count.value)]
        self._library.function("g_free", None, POINTER)(ctypes.cast(found, POINTER))
        return entries

    def run(self, name: str) -> None:
        """Execute a command."""
        self._library.checked("arv_camera_execute_command", None, POINTER, c_char_p)(self._camera, name.encode())

    def choose(self, name: str, entry: str, setting: str) -> None:
        """Set an enumeration. Raises ConfigError with the entries that there are."""
        self._require(name, setting)
        allowed = self.entries(name)
        if entry not in allowed:
            raise ConfigError(
                f"{FIELD}.{setting}: {entry!r} is not in {name} of {self.who}; it has "
                f"{', '.join(allowed) or 'none now'}"
            )
        self._library.checked("arv_camera_set_string", None, POINTER, c_char_p, c_char_p)(
            self._camera, name.encode(), entry.encode()
        )
        if (got := self.text(name)) != entry:
            raise ConfigError(f"{FIELD}.{setting}: {self.who} keeps {name} at {got}, asked for {entry}; see its manual")

    def switch(self, name: str, on: bool, setting: str) -> None:
        """Set a boolean."""
        self._require(name, setting)
        self._library.checked("arv_camera_set_boolean", None, POINTER, c_char_p, c_int)(
            self._camera, name.encode(), int(on)
        )

    def set_integer(self, name: str, value: int, setting: str) -> None:
        """Set an integer within its limits and steps. Raises ConfigError with the limits."""
        self._require(name, setting)
        low, high = c_int64(), c_int64()
        self._library.checked(
            "arv_camera_get_integer_bounds", None, POINTER, c_char_p, ctypes.POINTER(c_int64), ctypes.POINTER(c_int64)
        )(self._camera, name.encode(), byref(low), byref(high))
        step = max(
            1,
            self._library.checked("arv_camera_get_integer_increment", c_int64, POINTER, c_char_p)(
                self._camera, name.encode()
            ),
        )
        steps = f" in steps of {step}" if step > 1 else ""
        if not low.value <= value <= high.value or (value - low.value) % step:
            raise ConfigError(
                f"{FIELD}.{setting}: {name} of {self.who} takes {low.value} to {high.value}{steps}, not {value}"
            )
        self._library.checked("arv_camera_set_integer", None, POINTER, c_char_p, c_int64)(
            self._camera, name.encode(), value
        )
        if (got := self.integer(name)) != value:
            raise ConfigError(f"{FIELD}.{setting}: {self.who} keeps {name} at {got}, asked for {value}; see its manual")

    def _require(self, name: str, setting: str) -> None:
        if not self.has(name):
            raise ConfigError(f"{FIELD}.{setting}: {self.who} has no {name}, or not now; leave the setting out")

    # ------------------------------------------------------- what cameras call by several names: the library knows them

    def exposure_bounds_s(self) -> tuple[float, float]:
        """The shortest and the longest exposure."""
        low, high = c_double(), c_double()
        self._library.checked(
            "arv_camera_get_exposure_time_bounds", None, POINTER, ctypes.POINTER(c_double), ctypes.POINTER(c_double)
        )(self._camera, byref(low), byref(high))
        return low.value * 1e-6, high.value * 1e-6

    def set_exposure_s(self, exposure_s: float) -> float:
        """Set the exposure; what the camera made of it."""
        self._library.checked("arv_camera_set_exposure_time", None, POINTER, c_double)(self._camera, exposure_s * 1e6)
        return float(self._library.checked("arv_camera_get_exposure_time", c_double, POINTER)(self._camera)) * 1e-6

    def set_gain(self, gain: float) -> None:
        """Set the gain within its limits. Raises ConfigError with them."""
        if not self._library.checked("arv_camera_is_gain_available", c_int, POINTER)(self._camera):
            raise ConfigError(f"{FIELD}.gain: {self.who} has no gain; leave the setting out")
        low, high = c_double(), c_double()
        self._library.checked(
            "arv_camera_get_gain_bounds", None, POINTER, ctypes.POINTER(c_double), ctypes.POINTER(c_double)
        )(self._camera, byref(low), byref(high))
        if not low.value <= gain <= high.value:
            raise ConfigError(f"{FIELD}.gain: Gain of {self.who} takes {low.value:g} to {high.value:g}, not {gain:g}")
        self._library.checked("arv_camera_set_gain", None, POINTER, c_double)(self._camera, gain)
        got = float(self._library.checked("arv_camera_get_gain", c_double, POINTER)(self._camera))
        if abs(got - gain) > max(0.5, 0.05 * abs(gain)):
            raise ConfigError(f"{FIELD}.gain: {self.who} keeps Gain at {got:g}, asked for {gain:g}; see its manual")

    def description(self) -> str:
        """Vendor, model, serial number."""
        parts = ("vendor_name", "model_name", "device_serial_number")
        calls = [self._library.checked(f"arv_camera_get_{part}", c_char_p, POINTER) for part in parts]
        return " ".join((call(self._camera) or b"").decode(errors="replace") for call in calls)

    def trigger_by(self, source: str) -> None:
        """Let each picture wait for a trigger of this source."""
        self._library.checked("arv_camera_set_trigger", None, POINTER, c_char_p)(self._camera, source.encode())

    def automatics_off(self) -> None:
        """Exposure, gain and white balance as they are set, not as the camera likes."""
        for name in ("ExposureAuto", "GainAuto", "BalanceWhiteAuto"):
            if self.has(name) and "Off" in self.entries(name):
                self.choose(name, "Off", name)

    def temperature_c(self) -> float | None:
        """What the camera's own sensor says; None where it has none."""
        name = self.first_of("DeviceTemperature", "DeviceTemperatureRaw", "TemperatureAbs")
        try:
            return None if name is None else self.number(name)
        except AravisError:
            return None
