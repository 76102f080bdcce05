"""libaravis from Python by ctypes alone: the library speaks GenICam and GigE Vision, and is LGPL.

The usual binding is PyGObject, which has no wheels and must be built on each machine. This module needs only some forty
functions with plain C types. ctypes calls them without holding the GIL, on any Python version, with the distribution's
library (Debian: libaravis-0.8-0) or with the one in the wheel `aravis-python`, which is found without an import.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib.util
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from crosspih_common.errors import ConfigError, CrosspihError

API = "aravis-0.8"
POINTER = ctypes.c_void_p


class AravisError(CrosspihError):
    """A call of the library failed: `call` is the name of the C function, the text is the library's message."""

    def __init__(self, call: str, text: str) -> None:
        super().__init__(f"{call}: {text}")
        self.call, self.text = call, text


class _GError(ctypes.Structure):
    _fields_ = (("domain", ctypes.c_uint32), ("code", ctypes.c_int), ("message", ctypes.c_char_p))


class _GValue(ctypes.Structure):
    _fields_ = (("type", ctypes.c_size_t), ("data", ctypes.c_uint64 * 2))


G_TYPE_UINT = 7 << 2  # gtype.h: G_TYPE_MAKE_FUNDAMENTAL (7)
_GErrorPointer = ctypes.POINTER(_GError)


class Library:
    """One loaded libaravis: `function` is a plain call, `checked` raises AravisError where it fills a GError."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._so = ctypes.CDLL(path)
        self._lock = threading.Lock()
        self._functions: dict[str, Callable[..., Any]] = {}

    def function(self, name: str, returns: Any, *takes: Any) -> Callable[..., Any]:
        """A C function with its types."""
        with self._lock:
            if name not in self._functions:
                found = self._so[name]  # of this library or of GLib, which comes with it
                found.restype, found.argtypes = returns, list(takes)
                self._functions[name] = found
            return self._functions[name]

    def checked(self, name: str, returns: Any, *takes: Any) -> Callable[..., Any]:
        """A C function whose last argument is a GError; callers leave that argument out."""
        plain = self.function(name, returns, *takes, ctypes.POINTER(_GErrorPointer))
        free = self.function("g_error_free", None, _GErrorPointer)

        def call(*arguments: Any) -> Any:
            error = _GErrorPointer()
            result = plain(*arguments, ctypes.byref(error))
            if error:
                text = (error.contents.message or b"no text").decode(errors="replace")
                free(error)
                raise AravisError(name, text)
            return result

        return call

    def set_uint(self, instance: int, name: str, value: int) -> None:
        """Set a property of a GObject that is an unsigned 32-bit number."""
        held = _GValue()
        self.function("g_value_init", POINTER, ctypes.POINTER(_GValue), ctypes.c_size_t)(
            ctypes.byref(held), G_TYPE_UINT
        )
        self.function("g_value_set_uint", None, ctypes.POINTER(_GValue), ctypes.c_uint)(ctypes.byref(held), value)
        self.function("g_object_set_property", None, POINTER, ctypes.c_char_p, ctypes.POINTER(_GValue))(
            instance, name.encode(), ctypes.byref(held)
        )

    def unref(self, instance: int) -> None:
        """Release one reference to a GObject."""
        self.function("g_object_unref", None, POINTER)(instance)


def candidates(given: str = "") -> list[str]:
    """Paths to try for libaravis, in order: the given path alone, or else the system's library, then the wheel's."""
    if given:
        return [given]
    found = [name for name in (ctypes.util.find_library(API),) if name]
    spec = importlib.util.find_spec("aravis")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        found += [
            str(path) for path in sorted(Path(folder).glob(f"lib/lib{API}.*")) if path.suffix in (".so", ".dylib")
        ]
        found += [str(path) for path in sorted(Path(folder).glob(f"bin/*{API}*.dll"))]
    return found


def load(given: str = "") -> Library:
    """The first library that loads. Raises ConfigError saying how to get one."""
    reasons = []
    for path in candidates(given):
        try:
            return Library(path)
        except OSError as error:
            reasons.append(f"{path}: {error}")
    tried = "; ".join(reasons) or "none is installed"
    raise ConfigError(
        f"hardware.genicam.library: no lib{API} can be loaded ({tried}); install your distribution's (Debian: apt "
        "install libaravis-0.8-0) or the wheel (pip install 'crosspih[genicam]'), which needs "
        "GLib, libxml2 and libusb of the system"
    )
