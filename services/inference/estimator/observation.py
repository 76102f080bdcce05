"""The estimator's inputs and outputs. Pure data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class TouchObservation:
    """One guarded push, averaged while it still creeps.

    pose_base_peg: motor-side pose of the peg by the joints, in the middle of the averaging. wrench_peg (6,): force on
    the peg and moment about the F/T origin, N and Nm, peg frame, averaged. wrench_sd (6,): standard deviation of that
    average. compliance_peg (6, 6): twist of the peg frame (x, y, z, rx, ry, rz), peg frame, per wrench on the peg.
    to say nothing simple (jammed in the body, no contact); the estimator then leaves it out.
    """

    pose_base_peg: Pose
    wrench_peg: Array
    wrench_sd: Array
    compliance_peg: Array
    motion_direction_base: Array
    informative: bool = True

    def __post_init__(self) -> None:
        for name, shape in (
            ("wrench_peg", (6,)),
            ("wrench_sd", (6,)),
            ("compliance_peg", (6, 6)),
            ("motion_direction_base", (3,)),
        ):
            value = np.asarray(getattr(self, name), float)
            if value.shape != shape:
                raise ValueError(f"TouchObservation.{name} wants shape {shape}, got {value.shape}")
            object.__setattr__(self, name, value)
        if abs(float(np.linalg.norm(self.motion_direction_base)) - 1.0) > 1e-3:
            raise ValueError("TouchObservation.motion_direction_base wants a unit vector")

    def deflected_pose_base_peg(self) -> Pose:
        """The peg's true pose: the wrist deflects under the wrench."""
        twist = self.compliance_peg @ self.wrench_peg
        return self.pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3])


@dataclass(frozen=True, slots=True, eq=False)
class HolePosePrior:
    """The prior of the hole before touching: mean and covariance (6, 6), right perturbation, m and rad.

    tail_degrees: degrees of freedom of its Student-t tails; the smaller, the easier touches overrule it.
    """

    pose_base_hole: Pose
    covariance: Array
    tail_degrees: float = 5.0

    @classmethod
    def from_sd(
        cls, pose_base_hole: Pose, sd: tuple[float, float, float, float, float, float], tail_degrees: float = 5.0
    ) -> HolePosePrior:
        """From standard deviations along and about the hole's axes (x, y, z in m, rx, ry, rz in rad)."""
        return cls(pose_base_hole, np.diag(np.square(sd)), tail_degrees)


GAP_SD_M = 3e-5
SHARED_N = 2.0  # of the force of a touch: what may be carried by another point than is thought


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """How far the model is trusted: model errors in addition to the noise of a reading.

    gap_sd_m: how far from exact contact a touching pair may be (calibration of arm and compliance). force_floor_n,
    moment_floor_nm and relative_floor: added to the wrench's sd. gate: cost (a sum of squares over 6 + 1 residuals)
    beyond which a touch is left out; doubtful: from which on the search is repeated. friction_mean, friction_sd: prior
    of the friction coefficient. starts, finalists, samples: size of the search; retries: further searches while some
    touch stays doubtful. contacts: most per touch; candidates: pairs of pieces considered. draws: posterior draws per
    round, until they are worth wanted_draws independent ones.
    """

    gap_sd_m: float = GAP_SD_M
    force_floor_n: float = 0.03
    moment_floor_nm: float = 0.0015
    relative_floor: float = 0.002
    gate: float = 40.0
    doubtful: float = 20.0
    friction_mean: float = 0.1
    friction_sd: float = 0.1
    starts: int = 8
    finalists: int = 4
    samples: int = 240
    retries: int = 2
    contacts: int = 4
    candidates: int = 12
    draws: int = 160
    rounds: int = 5
    wanted_draws: float = 60.0

    @staticmethod
    def gap_sd_of(contact_stiffness_n_m: float | None) -> float:
        """The gap's sd, m, where contacts are compliant: one or two points share the force of a typical touch."""
        if contact_stiffness_n_m is None:
            return GAP_SD_M
        return float(np.hypot(GAP_SD_M, SHARED_N / contact_stiffness_n_m))


@dataclass(frozen=True, slots=True)
class ContactHypothesis:
    """A contact: feature kind ("edge on edge", "peg corner on face", "peg face on corner"), quarter 1..4 of the peg (1
    = about +x, 2 = +y, 3 = -x, 4 = -y: the arms of a cross), the hole's convex block, the normal force in N and the
    point on the peg, m, in the peg frame."""

    kind: str
    arm: int
    hole_block: int
    normal_force_n: float
    point_peg_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class TouchVerdict:
    """The fit's verdict on one touch: used or gated, its cost (sum of squares), and the contacts that explain it."""

    used: bool
    cost: float
    contacts: tuple[ContactHypothesis, ...]
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class HolePosterior:
    """The hole's pose after some touches.

    covariance (6, 6): right perturbation of pose_base_hole. rank: directions in which the touches at least halved the
    prior's sd. residual_cost: mean cost of the used touches (about 5 when model and noise are right). alternatives:
    other poses that explain the touches about as well, best first.
    """

    pose_base_hole: Pose
    covariance: Array
    rank: int
    residual_cost: float
    friction_coefficient: float
    friction_sd: float
    touches: tuple[TouchVerdict, ...]
    alternatives: tuple[Pose, ...] = ()

    @property
    def sd(self) -> Array:
        """Standard deviations (6,): x, y, z in m, rx, ry, rz in rad, hole frame."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))
