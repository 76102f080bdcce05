"""How sure a pose is: the fit's own covariance, what its edges show of it, and what the fit cannot know of itself."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.influence import jackknife
from services.vision.fit.quality import Quality
from services.vision.fit.rim import Rim
from services.vision.fit.solve import Fit

# chi2 of what the pictures say against the calibration (2) and against the drawing (4): from there on they make the
# covariance larger
OFFSET_FREE, SIZES_FREE = 2.0, 6.0
# of the fit's own covariance the part that all edges share (sizes, calibration, blur, lines and shades of all that face
# one way): by what they differ shows in the edges themselves. And of what shows there: edges that face one way go
# astray together, so that each counts what the next one counts again. Both as measured, so that 95 % of the truths
# lie in the region that is said to hold them
SHARED, APART = 0.25, 0.625
# marks move all edges that face one way: with a texture of 2 % of the step the shared variances are doubled
TEXTURED = 50.0


def covariance_of(fit: Fit, rim: Rim, quality: Quality, half_ranges: Array, beside: Array) -> Array:
    """What edges share (calibration, drawing, blur), more where the pictures pull at calibration or drawing and on a
    textured face; what they differ by (noise, glints, what covers them); and what stands `beside` (6, 6), other poses
    and the lenses' doubt; with what is known without any picture: half_ranges (6,), m and rad."""
    strain = max(quality.offset_conflict / OFFSET_FREE, quality.sizes_conflict / SIZES_FREE, 1.0)
    shared = SHARED * strain * (1.0 + TEXTURED * quality.rough) * fit.covariance[:6, :6]
    known = np.linalg.inv(shared + APART * jackknife(fit, rim) + beside) + np.diag(3.0 / half_ranges**2)
    covariance = np.linalg.inv(known)
    return np.asarray(0.5 * (covariance + covariance.T))
