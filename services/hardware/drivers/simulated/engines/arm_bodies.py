"""The moving bodies of an arm with its payload, for any engine: joint axes, masses, inertias.

The axes come from the arm's own kinematics at the zero pose. No link masses of the XB4 are published: those here are
our assumption, and light, because motors and gears sit on the motor side of the joint springs. They set the inertia,
hence how the arm rings and how hard it lands; nothing at rest depends on them, because gravity is fed forward.

Of the inertia about a joint's own axis a part is the gear's and motor's, seen through the gear. Without it the light
wrist links are too fast for a loop at 1 kHz that is stiff and explicit. For the XB4 it is given; for any other arm it
is the joint's stiffness divided by (240 rad/s)^2, about the XB4's own ratio, so that no joint alone rings faster than
40 Hz however stiff it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.truth import true_stiffness_nm_rad

# of all pieces of the peg together
PIECES_KG = 0.002
PIECES_SIZE_M = 0.05
RINGING_RAD_S = 240.0


@dataclass(frozen=True, slots=True)
class LinkMasses:
    """Of each link, from the base: its mass, kg, and the inertia added about its joint's own axis, kg m^2."""

    link_kg: tuple[float, ...]
    joint_kg_m2: tuple[float, ...]


XB4_MASSES = LinkMasses((3.0, 2.0, 1.5, 0.7, 0.5, 0.2), (0.3, 0.3, 0.2, 0.1, 0.1, 0.05))
# the two larger arms, light in the same way: about a third of the maker's figure, whose motors sit in the joints
NAMED_LINK_KG = {
    "ur5e": (1.3, 2.7, 0.8, 0.4, 0.4, 0.1),
    "panda": (1.6, 1.6, 1.2, 1.2, 1.1, 0.5, 0.25),
}


@dataclass(frozen=True, slots=True, eq=False)
class ArmBodies:
    """n links in frames parallel to the base at the zero pose, each with its origin on its joint's axis; then what
    hangs behind the sensor, in the peg frame {J}: the payload, and in it the peg's pieces, which weigh next to nothing.
    """

    axes: Array
    """Unit, (n, 3), in the base frame at the zero pose."""
    origins_m: Array
    """(n, 3), in the base frame at the zero pose."""
    middles_m: Array
    """Each link's centre of mass from its own origin, (n, 3)."""
    link_kg: Array
    """(n,)."""
    link_kg_m2: Array
    """Each link's inertia about its centre of mass, diagonal, axes parallel to the base's at the zero pose, (n, 3)."""
    pose_base_peg_zero: Pose
    payload_kg: float
    """All behind the sensor, the pieces included."""
    sensor_kg: float
    sensor_middle_m: Array
    """(3,): the pieces' masses are at the peg frame's origin, and the sensor body makes up for them."""
    sensor_kg_m2: float
    """About each axis through its centre of mass: a payload the size of a fist."""


def joint_lines(arm: ArmModel) -> tuple[Array, Array]:
    """The joints' axes, unit (n, 3), and a point on each, (n, 3), m, at the zero pose in the base frame.

    What kinematics leaves of rounding (1e-17 where a number is 0) is rounded off, so that axes along the base's axes
    are exactly that.
    """
    frames = arm.link_poses(np.zeros(len(arm.limits.lower_rad)))[:-1]
    axes = np.round([frame.rotation[:, 2] for frame in frames], 12) + 0.0
    origins_m = np.round([frame.translation_m for frame in frames], 12) + 0.0
    return axes / np.linalg.norm(axes, axis=1)[:, None], origins_m


def link_masses(arm: ArmModel, stiffness_nm_rad: Array, config: SimulatedConfig) -> LinkMasses:
    """What the links of an arm weigh: as the cell's file says; else the XB4's for the XB4, and by rule for any other.

    The rule: each link's mass by name, or for an unknown arm the XB4's by the link's place in the chain times the arm's
    length against the XB4's; the joint's own inertia by its stiffness (n,). Raises ConfigError.
    """
    count = len(arm.limits.lower_rad)
    given = config.link_masses_kg, config.joint_inertias_kg_m2
    for name, values in zip(("link_masses_kg", "joint_inertias_kg_m2"), given, strict=True):
        if values is not None and len(values) != count:
            raise ConfigError(f"hardware.simulated.{name} has {len(values)} numbers; arm {arm.name!r} wants {count}")
    if arm.name == "xb4":
        links, joints = XB4_MASSES.link_kg, XB4_MASSES.joint_kg_m2
    else:
        links = NAMED_LINK_KG.get(arm.name, ())
        if len(links) != count:
            links = _by_place(arm, count)
        joints = tuple((np.asarray(stiffness_nm_rad, float) / RINGING_RAD_S**2).tolist())
    return LinkMasses(given[0] or links, given[1] or joints)


_XB4_LENGTH_M = 0.997


def _by_place(arm: ArmModel, count: int) -> tuple[float, ...]:
    positions = [pose.translation_m for pose in arm.link_poses(np.zeros(count))]
    length_m = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    known = np.linspace(0.0, 1.0, len(XB4_MASSES.link_kg))
    links = np.interp(np.linspace(0.0, 1.0, count), known, XB4_MASSES.link_kg)
    return tuple((links * length_m / _XB4_LENGTH_M).tolist())


def nominal_joints_rad(workcell: Workcell) -> Array:
    """The joints (n,) with the peg where the hole should be: where the joints' damping is taken."""
    nominal = workcell.hole_prior.pose_base_hole() @ workcell.pose_flange_peg().inverse()
    return nearest(workcell.arm(), nominal, workcell.home_joints_rad)


def arm_bodies(workcell: Workcell, config: SimulatedConfig) -> ArmBodies:
    """The bodies of a work cell's arm and payload. Raises ConfigError for masses that do not fit the arm."""
    arm = workcell.arm()
    count = len(arm.limits.lower_rad)
    axes, origins_m = joint_lines(arm)
    flange = arm.pose_base_flange(np.zeros(count))
    masses = link_masses(arm, true_stiffness_nm_rad(workcell, config.truth), config)
    # the middle of each link, from its own joint
    ends = np.vstack([origins_m[1:], flange.translation_m])
    middles_m = (ends - origins_m) / 2.0
    inertias = []
    for kg, kg_m2, middle, axis in zip(masses.link_kg, masses.joint_kg_m2, middles_m, axes, strict=True):
        reach_m = float(np.linalg.norm(middle) * 2.0)
        inertia = np.full(3, kg * (reach_m**2 + 0.1**2) / 12.0)
        inertias.append(inertia + (1.0 + axis**2) / 2.0 * kg_m2)  # a disc across the axis
    payload_kg = config.force_torque.payload_kg
    sensor_kg = payload_kg - PIECES_KG
    return ArmBodies(
        axes=axes,
        origins_m=origins_m,
        middles_m=middles_m,
        link_kg=np.array(masses.link_kg),
        link_kg_m2=np.array(inertias),
        pose_base_peg_zero=flange @ workcell.pose_flange_peg(),
        payload_kg=payload_kg,
        sensor_kg=sensor_kg,
        sensor_middle_m=np.asarray(config.force_torque.payload_centroid_m, float) * (payload_kg / sensor_kg),
        sensor_kg_m2=payload_kg * 0.06**2 / 6.0,
    )
