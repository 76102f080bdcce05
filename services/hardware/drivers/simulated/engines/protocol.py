"""What a physics engine does for the simulated cell: the elastic arm, the payload behind the sensor, the hole.

The joints are elastic: the motor side follows its reference exactly, the link side hangs on it by spring and damper,

    tau = K (q_motor - q) + D (v_motor - v) + M(q) a_motor + h(q, v)

with gravity and inertia fed forward, so that only contact bends the arm at rest. K is the work cell's joint stiffness;
D_i = 2 zeta sqrt(K_i M_ii), M_ii in front of the hole. While the motor creeps at v against a wall the damper adds about
D v to K's force: with zeta = 0.5 (the default) that is an apparent deflection of some 3 to 7 micrometres at 1 mm/s.
What the change from approach to creep sets ringing (15 to 45 Hz) has died out after some 70 ms: observe for 0.1 s or
more. Only the peg and the hole can collide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

STEP_NS = 1_000_000
STEP_S = 1e-3
CONTACT_DAMPING_S = 2e-3  # of a contact that gives way: its damping over its stiffness


@dataclass(frozen=True, slots=True)
class ContactPoint:
    """One contact: where, and the force on the peg, friction included; both (3,) in the base frame, m and N."""

    point_base_m: Array
    force_base_n: Array


class Physics(Protocol):
    """One world. One thread at a time; get one by `open_engine`, then `build` before anything else."""

    @property
    def joints_rad(self) -> Array:
        """The link side (n,), rad: where the arm really is."""

    def build(self, pose_base_hole: Pose, joints_rad: Array) -> None:
        """Make the world anew, at rest at joints (n,): nothing of what was before can be felt."""

    def step(self, joints_rad: Array, speeds_rad_s: Array, accelerations_rad_s2: Array) -> None:
        """One millisecond (`STEP_S`) with the motor side at a reference; each (n,)."""

    def wrench_sensed(self) -> Array:
        """What an ideal sensor reads (6,), N and Nm: on the peg, in the peg frame about its origin, unless the sensor
        is mounted otherwise. Contact, weight and inertia of all behind the sensor.
        """

    def pose_base_peg(self) -> Pose:
        """Where the peg really is: the link side."""

    def contacts(self) -> list[ContactPoint]:
        """Every contact that carried force in the last step."""

    def deepest_penetration_m(self) -> float:
        """How far peg and hole overlap as they stand, m; 0 when they do not."""

    def close(self) -> None:
        """Give back what was taken; a second call does nothing."""
