"""What the controller's set-points move: joints of its own here, the simulated cell's in simulated_cell.py."""

from __future__ import annotations

import contextlib
import socket
import struct
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import skew
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import SimulationTruth
from services.hardware.peers.seen import JointsTeller

GRAVITY_BASE_M_S2 = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True, slots=True, eq=False)
class SensedState:
    """After a cycle: encoders (6,), rad and rad/s, and the wrist sensor's raw reading (6,) at the flange, N and Nm."""

    joints_rad: Array
    speeds_rad_s: Array
    raw: Array


class JointSource(Protocol):
    """What is behind the controller. Called once in each of its cycles."""

    model: ArmModel

    def advance(self, joints_rad: Array, speeds_rad_s: Array) -> SensedState:
        """A cycle in which the controller wants the joints there, so fast."""

    def restart(self, seed: int | None) -> SensedState:
        """A new trial of the seed; None: of its own."""

    def truth(self) -> SimulationTruth | None:
        """What only a simulated cell knows."""

    def close(self) -> None:
        """Let go."""


class OwnJoints:
    """Each joint follows its set-point as a second-order system; the sensor feels a weight, noise and no contact.

    30 Hz and nine tenths of critical damping are this program's assumption: no maker publishes either.
    """

    def __init__(
        self, model: ArmModel, home_rad: Array, period_s: float, weight_kg: float = 0.974, noise_n: float = 0.1,
        hertz: float = 30.0, damping: float = 0.9,
    ) -> None:  # fmt: skip
        self.model = model
        self._home_rad, self._period_s = np.array(home_rad, float), period_s
        self._noise = np.repeat([noise_n, 0.05 * noise_n], 3)
        self._omega, self._damping = 2.0 * np.pi * hertz, damping
        self._weight_n, self._centroid_m = weight_kg * GRAVITY_BASE_M_S2, np.array([0.0006, 0.0011, 0.099])
        self.restart(None)

    def restart(self, seed: int | None) -> SensedState:
        """Home, at rest."""
        self._rng = np.random.default_rng(seed or 0)
        self._joints, self._speeds = self._home_rad.copy(), np.zeros(len(self._home_rad))
        return self._felt()

    def advance(self, joints_rad: Array, speeds_rad_s: Array) -> SensedState:
        """Semi-implicit Euler over a cycle, in four steps."""
        step_s = self._period_s / 4.0
        for _ in range(4):
            self._speeds += step_s * (
                self._omega**2 * (joints_rad - self._joints)
                + 2.0 * self._damping * self._omega * (speeds_rad_s - self._speeds)
            )
            self._joints = self._joints + step_s * self._speeds
        return self._felt()

    def _felt(self) -> SensedState:
        turn = self.model.pose_base_flange(self._joints).rotation
        force = turn.T @ self._weight_n
        raw = np.concatenate([force, skew(self._centroid_m) @ force]) + self._rng.standard_normal(6) * self._noise
        return SensedState(self._joints.copy(), self._speeds.copy(), raw)

    def truth(self) -> SimulationTruth | None:
        """None: nothing is there but the arm."""
        return None

    def close(self) -> None:
        """Nothing to let go of."""


class FeedingJoints:
    """Another source, whose wrist sensor's reading is sent on after each cycle to the other end of a sensor of its own.

    A datagram is six little-endian doubles, Fx Fy Fz in N, Tx Ty Tz in Nm (services/operator/bench/protocols/feed.py).
    """

    def __init__(self, source: JointSource, host: str, port: int) -> None:
        self._source, self._address = source, (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.model = source.model

    def advance(self, joints_rad: Array, speeds_rad_s: Array) -> SensedState:
        """A cycle of the other source."""
        return self._sent(self._source.advance(joints_rad, speeds_rad_s))

    def restart(self, seed: int | None) -> SensedState:
        """A new trial of the other source."""
        return self._sent(self._source.restart(seed))

    def _sent(self, felt: SensedState) -> SensedState:
        with contextlib.suppress(OSError):  # nobody listens
            self._socket.sendto(struct.pack("<6d", *felt.raw), self._address)
        return felt

    def truth(self) -> SimulationTruth | None:
        """The other source's."""
        return self._source.truth()

    def close(self) -> None:
        """Let go of the other source."""
        self._source.close()
        self._socket.close()


class SeenJoints:
    """Another source, whose joints are told to simulated cameras of another process (following.py)."""

    def __init__(self, source: JointSource, seen: JointsTeller) -> None:
        self._source, self._seen = source, seen
        self.model = source.model

    def advance(self, joints_rad: Array, speeds_rad_s: Array) -> SensedState:
        """A cycle of the other source."""
        return self._told(self._source.advance(joints_rad, speeds_rad_s))

    def restart(self, seed: int | None) -> SensedState:
        """A new trial of the other source."""
        return self._told(self._source.restart(seed))

    def _told(self, felt: SensedState) -> SensedState:
        self._seen.cycle(felt.joints_rad)
        return felt

    def truth(self) -> SimulationTruth | None:
        """The other source's."""
        return self._source.truth()

    def close(self) -> None:
        """Let go of the other source."""
        self._source.close()
        self._seen.close()
