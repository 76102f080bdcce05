"""Controllers on loopback for tests, each on an address of its own."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from crosspih_common.arm import NAMED_ARMS
from services.hardware.peers.ur.ports import ControllerPorts
from services.hardware.peers.ur.robot import Robot
from services.hardware.peers.ur.sources import OwnJoints

E_SERIES, CB3 = (5, 12, 0, 1101319), (3, 15, 0, 106331)
_NUMBERS = itertools.count(1)


def address() -> str:
    """One that no other test process uses: Linux answers on all of 127/8."""
    process, number = os.getpid(), next(_NUMBERS)
    return f"127.{1 + (process >> 8) % 250}.{process % 256}.{number}"


def robot(version: tuple[int, int, int, int] = E_SERIES, model: str = "UR5", weight_kg: float = 0.974) -> Robot:
    """A controller whose cycles the test makes."""
    arm, period_s = NAMED_ARMS["ur5e"], 0.002 if version[0] >= 5 else 0.008
    made = Robot(OwnJoints(arm.make(), np.asarray(arm.home_rad), period_s, weight_kg), model, version, period_s)
    made.payload_kg, made.payload_cog_m = weight_kg, [0.0006, 0.0011, 0.099]
    return made


@contextmanager
def running(made: Robot) -> Iterator[str]:
    """The controller's cycles in a thread of this process, its ports on the address that is given."""
    where, closing = address(), threading.Event()
    ports = ControllerPorts(made, where)
    loop = threading.Thread(target=made.run, args=(closing,))
    loop.start()
    try:
        yield where
    finally:
        closing.set()
        loop.join()
        ports.close()
