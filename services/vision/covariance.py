"""The covariance of a pose: from the fit, from the disagreement of its edges, and from errors the fit cannot see."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.influence import jackknife
from services.vision.fit.quality import Quality
from services.vision.fit.rim import Rim
from services.vision.fit.solve import Fit

# chi2 of the conflict with the calibration (2 dof) and with the drawing (4 dof); above it the covariance is enlarged
OFFSET_FREE, SIZES_FREE = 2.0, 6.0
# SHARED: factor on the fit's covariance for errors that all edges share (sizes, calibration, blur, lines and shades of
# edges that face one way). APART: factor on the covariance from the disagreement of the edges, because edges that face
# one way are off together and are counted twice. Both are calibrated so that the 95 % regions hold 95 % of the truths
SHARED, APART = 0.25, 0.625
# marks on the face move all edges that face one way: a texture of 2 % of the step doubles the shared variances
TEXTURED = 50.0


def covariance_of(fit: Fit, rim: Rim, quality: Quality, half_ranges: Array, beside: Array) -> Array:
    """The covariance (6, 6) of x, y, z, rx, ry, rz of the hole's frame, m and rad: errors that edges share
    (calibration, drawing, blur), enlarged on conflicts and on a textured face; plus errors by which edges differ
    (noise, glints, occlusion); plus `beside` (6, 6), from rival poses and the lenses' doubt. It is combined with the
    prior half_ranges (6,), m and rad."""
    strain = max(quality.offset_conflict / OFFSET_FREE, quality.sizes_conflict / SIZES_FREE, 1.0)
    shared = SHARED * strain * (1.0 + TEXTURED * quality.rough) * fit.covariance[:6, :6]
    known = np.linalg.inv(shared + APART * jackknife(fit, rim) + beside) + np.diag(3.0 / half_ranges**2)
    covariance = np.linalg.inv(known)
    return np.asarray(0.5 * (covariance + covariance.T))
