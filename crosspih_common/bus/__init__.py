"""The typed bus: publish, subscribe, command and liveliness over Zenoh, or in memory for unit tests."""

from crosspih_common.bus.bus import Bus, Latest, Publisher
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.bus.zenoh_transport import ALIVE_LEASE_MS, DEFAULT_ENDPOINT, open_zenoh

__all__ = [
    "ALIVE_LEASE_MS",
    "DEFAULT_ENDPOINT",
    "Bus",
    "Latest",
    "MemoryHub",
    "Publisher",
    "open_zenoh",
]
