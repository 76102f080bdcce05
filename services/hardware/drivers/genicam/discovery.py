"""Which cameras answer on the networks of this machine."""

from __future__ import annotations

from ctypes import c_char_p, c_uint
from dataclasses import dataclass

from crosspih_common.aravis import Library


@dataclass(frozen=True, slots=True)
class Discovered:
    """A camera that answered the discovery."""

    device_id: str
    serial: str
    address: str
    physical: str
    model: str

    def __contains__(self, name: str) -> bool:
        return name in (self.device_id, self.serial, self.address, self.physical)

    def __str__(self) -> str:
        return f"{self.model}, serial {self.serial}, at {self.address}"


def discovered(library: Library) -> list[Discovered]:
    """The cameras that answer now, on all networks of this machine; it takes about a second."""
    library.function("arv_update_device_list", None)()
    count = int(library.function("arv_get_n_devices", c_uint)())

    def said(what: str, index: int) -> str:
        value = library.function(f"arv_get_device_{what}", c_char_p, c_uint)(index)
        return (value or b"").decode(errors="replace")

    return [
        Discovered(*(said(what, index) for what in ("id", "serial_nbr", "address", "physical_id", "model")))
        for index in range(count)
    ]


def found_now(library: Library) -> str:
    """What answers, in words."""
    cameras = [str(camera) for camera in discovered(library)]
    return (
        "what answers: " + "; ".join(cameras)
        if cameras
        else ("no camera answers: is it powered, its cable in, and its address in this machine's network?")
    )
