"""The cell in MuJoCo, one millisecond at a time."""

from __future__ import annotations

import mujoco
import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.arm_bodies import arm_bodies, nominal_joints_rad
from services.hardware.drivers.simulated.engines.mujoco.world import HOLE, PEG, soften, world_xml
from services.hardware.drivers.simulated.engines.protocol import CONTACT_DAMPING_S, ContactPoint
from services.hardware.drivers.simulated.truth import TrueSensorMounting, true_hole, true_pieces, true_stiffness_nm_rad


class MujocoPhysics:
    """Implements the Physics protocol by one MuJoCo model. One thread at a time."""

    def __init__(self, workcell: Workcell, config: SimulatedConfig) -> None:
        self._workcell = workcell
        self._mounting = TrueSensorMounting(config.truth)
        self._stiffness = true_stiffness_nm_rad(workcell, config.truth)
        peg = [piece.vertices_m() for piece in true_pieces(workcell, config.truth)]
        hole = [piece.vertices_m() for piece in true_hole(workcell, config.truth).pieces()]
        bodies = arm_bodies(workcell, config)
        self._model = mujoco.MjModel.from_xml_string(
            world_xml(bodies, peg, hole, config.friction_coefficient, workcell.gravity_base_m_s2)
        )
        if config.contact_stiffness_n_m is not None:
            stiffness_n_m = config.contact_stiffness_n_m
            soften(self._model, stiffness_n_m, CONTACT_DAMPING_S * stiffness_n_m)
        self._data = mujoco.MjData(self._model)
        self._peg_geoms = frozenset(int(self._model.geom(f"{PEG}{index}").id) for index in range(len(peg)))
        self._mocap = int(self._model.body(HOLE).mocapid[0])
        self.joints_rad = np.zeros(len(self._stiffness))
        diagonal = np.diag(self.mass_matrix(nominal_joints_rad(workcell)))
        self._damping = 2.0 * config.joint_damping_ratio * np.sqrt(self._stiffness * diagonal)

    def mass_matrix(self, joints_rad: Array) -> Array:
        """M (n, n), kg m^2, at joints (n,); the world stays as it is."""
        data = mujoco.MjData(self._model)
        data.qpos[:] = joints_rad
        mujoco.mj_fwdPosition(self._model, data)
        columns = np.zeros((len(joints_rad), len(joints_rad)))
        for column, unit in zip(columns, np.eye(len(joints_rad)), strict=True):
            mujoco.mj_mulM(self._model, data, column, unit)
        return columns

    def close(self) -> None:
        """Nothing is held that Python does not give back by itself."""

    def build(self, pose_base_hole: Pose, joints_rad: Array) -> None:
        """Make the world anew, at rest: nothing of what was before can be felt."""
        data = self._data
        mujoco.mj_resetData(self._model, data)
        x, y, z, w = pose_base_hole.quaternion_xyzw().tolist()
        data.mocap_pos[self._mocap] = pose_base_hole.translation_m
        data.mocap_quat[self._mocap] = w, x, y, z
        data.qpos[:] = joints_rad
        self.joints_rad = data.qpos.copy()

    def step(self, joints_rad: Array, speeds_rad_s: Array, accelerations_rad_s2: Array) -> None:
        """One millisecond with the motor side at a reference; each (n,)."""
        model, data = self._model, self._data
        mujoco.mj_step1(model, data)
        torque = data.qfrc_applied
        mujoco.mj_mulM(model, data, torque, accelerations_rad_s2)
        torque += data.qfrc_bias
        torque += self._stiffness * (joints_rad - data.qpos)
        torque += self._damping * (speeds_rad_s - data.qvel)
        mujoco.mj_step2(model, data)
        self.joints_rad = data.qpos.copy()

    def wrench_sensed(self) -> Array:
        """What an ideal sensor reads (6,), N and Nm: on the peg, in the peg frame about its origin.

        MuJoCo gives what the parent's side does to the peg's, with the opposite sign.
        """
        return self._mounting.felt(-self._data.sensordata)

    def pose_base_peg(self) -> Pose:
        """Where the peg really is: the link side."""
        return self._workcell.pose_base_peg(self.joints_rad)

    def contacts(self) -> list[ContactPoint]:
        """Every contact that carried force in the last step."""
        found = []
        wrench = np.zeros(6)
        for index in range(self._data.ncon):
            contact = self._data.contact[index]
            mujoco.mj_contactForce(self._model, self._data, index, wrench)
            if wrench[0] > 0.0:
                # the rows of the frame: the normal, from the first geom to the second, and two tangents
                on_second = wrench[:3] @ np.reshape(contact.frame, (3, 3))
                force = -on_second if int(contact.geom[0]) in self._peg_geoms else on_second
                found.append(ContactPoint(np.array(contact.pos), np.asarray(force)))
        return found

    def deepest_penetration_m(self) -> float:
        """How far peg and hole overlap as they stand, m; 0 when they do not."""
        data = mujoco.MjData(self._model)
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = (
            self._data.qpos, self._data.mocap_pos, self._data.mocap_quat,
        )  # fmt: skip
        mujoco.mj_fwdPosition(self._model, data)
        return max((-float(data.contact[index].dist) for index in range(data.ncon)), default=0.0)


ENGINE = MujocoPhysics
