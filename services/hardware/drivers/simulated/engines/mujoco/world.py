"""The arm with its peg and the fixture with its hole as a MuJoCo model, in the words of its XML.

What is set, and why, measured on single contacts against the contact mechanics as in
tests/inference/mechanics/test_cell_agreement.py:

- `multiccd` is off. With it MuJoCo makes several contacts of one, and where an edge meets an edge or a face some of
  them carry a face's normal: without friction the force points up to 1.8 degrees wrong and the moment is 16 mNm off,
  instead of 0.04 degrees and 0.14 mNm. Off, faces that lie flat on each other touch at one point for each pair of
  convex pieces: steady up to some 15 Nm, while a peg levered against its bore with 20 Nm and more rattles by some N.
- `ccd_tolerance` is 1e-12 m, not 1e-6, because what presses overlaps by less than a micrometre.
- `solref` is three times the step. Twice the step is the stiffest that MuJoCo takes (with `solimp` some 24 N/um), but
  there a contact that slides lets go for one step and comes back with twice the force in the next; half a step with the
  same stiffness per step does likewise.
- `impratio` is 1000: friction that holds does not creep (at 20, 4 N of it let go by 0.07 N in half a second).
- The peg's pieces and the hole's are exact, with no margin and no inset, and only they can collide.
"""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.engines.arm_bodies import PIECES_KG, PIECES_SIZE_M, ArmBodies
from services.hardware.drivers.simulated.engines.protocol import STEP_S

PEG, HOLE, SENSOR = "peg", "hole", "sensor"
_CONTACT = f'condim="3" solref="{3.0 * STEP_S} 1" solimp="0.95 0.99 0.0001"'
_SOFT_IMPEDANCE = 0.1


def world_xml(
    arm: ArmBodies, peg: list[Array], hole: list[Array], friction: float, gravity_m_s2: Iterable[float]
) -> str:
    """The model: `peg` and `hole` are the corners (k, 3), m, of convex pieces, in the peg's and the hole's frame.

    The hole hangs on a mocap body, so that it can be put elsewhere; the sensors are force and torque at the peg frame.
    """
    pairs = "".join(
        f'<pair geom1="{PEG}{one}" geom2="{HOLE}{other}" friction="{friction} {friction} 0 0 0" {_CONTACT}/>'
        for one in range(len(peg))
        for other in range(len(hole))
    )
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{STEP_S}" gravity="{_words(gravity_m_s2)}" integrator="Euler" cone="elliptic" '
        'impratio="1000" iterations="60" tolerance="1e-12" ccd_iterations="200" ccd_tolerance="1e-12">'
        '<flag multiccd="disable" autoreset="disable"/></option>'
        f"<asset>{_meshes(PEG, peg)}{_meshes(HOLE, hole)}</asset>"
        f'<worldbody><body name="{HOLE}" mocap="true">{_geoms(HOLE, len(hole))}</body>{_arm(arm, len(peg))}</worldbody>'
        f'<contact>{pairs}</contact><sensor><force site="{SENSOR}"/><torque site="{SENSOR}"/></sensor></mujoco>'
    )


def soften(model: mujoco.MjModel, stiffness_n_m: float, damping_n_s_m: float) -> None:
    """Contact points that give way, along their normal, by a spring and a damper.

    With an impedance d that is the same at every depth, and the inverse mass w of the peg's body as MuJoCo takes it for
    all its contacts, a contact at rest carries s r / ((1 - d) w) at the overlap r, where -s is the first number of
    `solref`. It also resists like a mass of d / ((1 - d) w), which a small d keeps small. Friction stays as hard as it
    is in the rigid cell.
    """
    per_newton = (1.0 - _SOFT_IMPEDANCE) * float(model.body(PEG).invweight0[0])
    model.pair_solref[:] = -stiffness_n_m * per_newton, -damping_n_s_m * per_newton
    model.pair_solimp[:, :3] = _SOFT_IMPEDANCE, _SOFT_IMPEDANCE, 1e-4
    model.pair_solreffriction[:] = 3.0 * STEP_S / _SOFT_IMPEDANCE, 1.0


def _words(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _meshes(name: str, pieces: list[Array]) -> str:
    return "".join(
        f'<mesh name="{name}{index}" inertia="convex" vertex="{_words(piece.ravel())}"/>'
        for index, piece in enumerate(pieces)
    )


def _geoms(name: str, count: int) -> str:
    return "".join(
        f'<geom name="{name}{index}" type="mesh" mesh="{name}{index}" mass="0" contype="0" conaffinity="0"/>'
        for index in range(count)
    )


def _inertial(kg: float, middle_m: Iterable[float], kg_m2: Iterable[float]) -> str:
    return f'<inertial mass="{kg!r}" pos="{_words(middle_m)}" diaginertia="{_words(kg_m2)}"/>'


def _arm(arm: ArmBodies, pieces: int) -> str:
    """Each link's body inside the one before it; the frames are those of `ArmBodies`."""
    text = ""
    before_m = np.zeros(3)
    for index, (origin_m, axis) in enumerate(zip(arm.origins_m, arm.axes, strict=True)):
        text += f'<body pos="{_words(origin_m - before_m)}"><joint name="joint{index}" axis="{_words(axis)}"/>'
        text += _inertial(float(arm.link_kg[index]), arm.middles_m[index], arm.link_kg_m2[index])
        before_m = origin_m
    at_zero = Pose(arm.pose_base_peg_zero.rotation, arm.pose_base_peg_zero.translation_m - before_m)
    x, y, z, w = at_zero.quaternion_xyzw().tolist()
    text += f'<body pos="{_words(at_zero.translation_m)}" quat="{_words((w, x, y, z))}"><site name="{SENSOR}"/>'
    text += _inertial(arm.sensor_kg, arm.sensor_middle_m, [arm.sensor_kg_m2] * 3)
    text += f'<body name="{PEG}">{_inertial(PIECES_KG, np.zeros(3), [PIECES_KG * PIECES_SIZE_M**2 / 6.0] * 3)}'
    return text + _geoms(PEG, pieces) + "</body></body>" + "</body>" * len(arm.link_kg)
