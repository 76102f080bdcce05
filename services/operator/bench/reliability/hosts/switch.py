"""The network between the hosts: `python -m services.operator.bench.reliability.hosts.switch ADDRESS=FD...`.

Each host has a TUN device, whose other end is the file descriptor FD here. Packets are forwarded by their destination
after a delay, and some of them are lost; a host whose cable is out gets and sends none. So the hosts' own kernels speak
TCP over a link of any chosen quality.

Each line on standard input is one JSON object, {"delay_s": 0.05, "loss": 0.01, "out": ["10.77.0.1"]}; the answer is the
number of packets passed on and lost so far.
"""

from __future__ import annotations

import contextlib
import heapq
import ipaddress
import json
import os
import random
import selectors
import sys
import time
from dataclasses import dataclass, field

from crosspih_common.service.urgency import be_urgent

IPV4, DESTINATION = 4, slice(16, 20)
LARGEST = 65536
SEED = 1


@dataclass
class Switch:
    """Ports by IPv4 address; packets under way, ordered by the time at which they are due."""

    ports: dict[bytes, int]
    delay_s: float = 0.0
    loss: float = 0.0
    out: frozenset[bytes] = frozenset()
    passed: int = 0
    lost: int = 0
    cut: int = 0
    _under_way: list[tuple[float, int, int, bytes]] = field(default_factory=list)
    _chance: random.Random = field(default_factory=lambda: random.Random(SEED))

    def take(self, source: bytes, packet: bytes, now_s: float) -> None:
        """A packet that a host sent."""
        destination = packet[DESTINATION]
        port = self.ports.get(destination)
        if port is None or packet[0] >> 4 != IPV4:
            return  # a router solicitation, a broadcast
        if source in self.out or destination in self.out:
            self.cut += 1
        elif self._chance.random() < self.loss:
            self.lost += 1
        else:
            self.passed += 1
            heapq.heappush(self._under_way, (now_s + self.delay_s, self.passed, port, packet))

    def hand_on(self, now_s: float) -> float | None:
        """Deliver the packets that are due; returns the time until the next one, None when none is under way."""
        while self._under_way and self._under_way[0][0] <= now_s:
            port, packet = heapq.heappop(self._under_way)[2:]
            with contextlib.suppress(OSError):  # that host's device is down
                os.write(port, packet)
        return max(self._under_way[0][0] - now_s, 0.0) if self._under_way else None

    def told(self, wanted: dict[str, object]) -> dict[str, int]:
        """Change the link as a command line says; returns the counts."""
        self.delay_s = float(str(wanted.get("delay_s", self.delay_s)))
        self.loss = float(str(wanted.get("loss", self.loss)))
        out = wanted.get("out")
        if isinstance(out, list):
            self.out = frozenset(packed(str(address)) for address in out)
        return {"passed": self.passed, "lost": self.lost, "cut": self.cut}


def packed(address: str) -> bytes:
    """An IPv4 address as 4 bytes, as in a packet."""
    return ipaddress.IPv4Address(address).packed


def main(words: list[str]) -> int:
    """Forward packets until standard input ends."""
    ports = {packed(address): int(fd) for address, _, fd in (word.partition("=") for word in words)}
    switch = Switch(ports)
    be_urgent()
    with selectors.DefaultSelector() as ready:
        for address, fd in ports.items():
            os.set_blocking(fd, False)
            ready.register(fd, selectors.EVENT_READ, address)
        ready.register(sys.stdin, selectors.EVENT_READ)
        wait_s: float | None = None
        while True:
            for key, _ in ready.select(wait_s):
                if key.data is None:
                    line = sys.stdin.readline()
                    if not line:
                        return 0
                    print(json.dumps(switch.told(json.loads(line))), flush=True)
                    continue
                with contextlib.suppress(BlockingIOError):
                    while True:
                        switch.take(key.data, os.read(key.fd, LARGEST), time.monotonic())
            wait_s = switch.hand_on(time.monotonic())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
