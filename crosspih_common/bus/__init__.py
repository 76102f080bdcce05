"""The typed bus: publish, subscribe, command and liveliness over Zenoh, or in memory for unit tests."""

from crosspih_common.bus.bus import Bus, Latest, Publisher
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.bus.zenoh_transport import COMPUTING_LEASE_MS, DEFAULT_ENDPOINT, LEASE_MS, open_zenoh

__all__ = [
    "COMPUTING_LEASE_MS",
    "DEFAULT_ENDPOINT",
    "LEASE_MS",
    "Bus",
    "Latest",
    "MemoryHub",
    "Publisher",
    "open_zenoh",
]
