"""The wrench of contacts on the peg (Eqs. 17 and 20-24), with the friction of a sliding contact."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import wrench_of_force_at_point

ISOTROPIC_COMPLIANCE = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def axial_share(force_n: ArrayLike) -> Array:
    """n_z0 of forces (..., 3): the axial share |Fz| / |F| (Eq. 17, printed without its sign)."""
    force = np.asarray(force_n, float)
    return np.asarray(np.abs(force[..., 2]) / np.linalg.norm(force, axis=-1))


def sliding_direction(
    normal_peg: Array, point_peg_m: Array, motion_peg: Array, compliance_peg: Array | None = None
) -> Array:
    """The unit direction (..., 3) in which the touching point of the peg slides, in the peg frame.

    The wrist is driven along motion_peg (..., 3) and deflects by compliance_peg (..., 6, 6) (twist of the peg frame per
    wrench), so that the point stays in the contact plane: v = d - C n (n.d)/(n.C n), C the compliance at the point.
    Without a compliance, or with the same one in all directions, v is the projection of the motion on the plane.
    """
    compliance = ISOTROPIC_COMPLIANCE if compliance_peg is None else compliance_peg
    pushed = np.einsum("...ij,...j->...i", compliance, wrench_of_force_at_point(normal_peg, point_peg_m))
    gives = pushed[..., :3] + np.cross(pushed[..., 3:], point_peg_m)
    closing = np.einsum("...i,...i->...", normal_peg, motion_peg) / np.einsum("...i,...i->...", normal_peg, gives)
    velocity = motion_peg - gives * closing[..., None]
    velocity = velocity - normal_peg * np.einsum("...i,...i->...", normal_peg, velocity)[..., None]
    return np.asarray(velocity / np.maximum(np.linalg.norm(velocity, axis=-1, keepdims=True), 1e-9))


def contact_wrench_basis(
    normal_peg: Array,
    point_peg_m: Array,
    motion_peg: Array,
    friction_coefficient: ArrayLike,
    compliance_peg: Array | None = None,
) -> Array:
    """The wrench (..., 6) in the peg frame of a contact pressed with a normal force of 1 N, friction included.

    One contact's wrench is a nonnegative multiple of it; the wrench of several contacts is a nonnegative sum (Eqs.
    21-24). If the wrist's force on the stuck point lies inside the friction cone, the contact sticks and the force is
    the wrist's; otherwise the point slides (`sliding_direction`) and friction opposes it.
    """
    mu = np.asarray(friction_coefficient, float)
    slide = sliding_direction(normal_peg, point_peg_m, motion_peg, compliance_peg)
    stuck = _stuck_force(point_peg_m, motion_peg, compliance_peg)
    pressed = np.einsum("...i,...i->...", stuck, normal_peg)
    stuck = stuck / np.where(pressed > 1e-12, pressed, 1.0)[..., None]
    tangential = np.linalg.norm(stuck - normal_peg, axis=-1)
    sticks = (pressed > 1e-12) & (tangential <= mu)
    force = np.where(sticks[..., None], stuck, normal_peg - mu[..., None] * slide)
    return wrench_of_force_at_point(force, point_peg_m)


def _stuck_force(point_peg_m: Array, motion_peg: Array, compliance_peg: Array | None) -> Array:
    """The force (..., 3) on the peg, up to scale, of a contact that holds its point against the motion: -C^-1 d."""
    if compliance_peg is None:
        return np.broadcast_to(-motion_peg, np.broadcast_shapes(motion_peg.shape, point_peg_m.shape))
    x, y, z = np.moveaxis(point_peg_m, -1, 0)
    zero = np.zeros_like(x)
    lever = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=-2)
    c = compliance_peg
    back = np.swapaxes(lever, -1, -2)
    # Velocity of the point is v + w x p = v - p x w; the wrench of a force there is (f, p x f).
    at_point = c[..., :3, :3] + c[..., :3, 3:] @ lever - lever @ c[..., 3:, :3] + back @ c[..., 3:, 3:] @ lever
    scale = np.einsum("...ii->...", at_point)[..., None, None] / 3.0
    cofactor = np.linalg.inv(at_point / scale)
    return np.asarray(-np.einsum("...ij,...j->...i", cofactor, motion_peg))


def equal_arms_axial_share(axial_over_lateral: ArrayLike, arms: int) -> Array:
    """n_z0 when 1 to 4 neighbouring arms press equally and in the same sense (Tables 2-5), any shape.

    axial_over_lateral: of one arm's force. The axial parts add up; the lateral ones, at 90 degrees to each other, add
    up to 1, sqrt 2, 1 and 0 times one arm's.
    """
    if not 1 <= arms <= 4:
        raise ValueError(f"arms wants 1 to 4, got {arms}")
    ratio = np.asarray(axial_over_lateral, float)
    lateral = (1.0, np.sqrt(2.0), 1.0, 0.0)[arms - 1]
    return np.asarray(arms * ratio / np.hypot(lateral, arms * ratio))
