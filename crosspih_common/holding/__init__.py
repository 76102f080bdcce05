"""Holding the arm: the holder's side of the lease that every motion needs."""

from crosspih_common.holding.lease import ArmLease, hold_arm
from crosspih_common.holding.pulse import Pulse, pulse_of

__all__ = ["ArmLease", "Pulse", "hold_arm", "pulse_of"]
