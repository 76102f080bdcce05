"""How sure a pose is: the fit's own covariance, and what the fit cannot know of itself."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.quality import Quality
from services.vision.fit.solve import Fit

# chi2 of what the pictures say against the calibration (2) and against the drawing (4): from there on they make the
# covariance larger
OFFSET_FREE, SIZES_FREE = 2.0, 6.0
# errors have wider tails than a Gaussian: its variances times
TAIL = 1.5
# the less of the rim is seen, the more what covers it may have pulled at the rest: a third hidden, variances times 3.7
HIDDEN = 8.0
# marks along an edge move it as a whole: with a texture of 2 % of the step variances are doubled
TEXTURED = 50.0


def covariance_of(fit: Fit, quality: Quality, half_ranges: Array, beside: Array) -> Array:
    """The fit's own (noise, blur, calibration, drawing, edges that are off), more where the pictures pull at the
    calibration or at the drawing; and what stands `beside` (6, 6), other poses and the lenses' doubt; with what is
    known without any picture: half_ranges (6,), m and rad."""
    posterior = fit.covariance[:6, :6]
    strain = TAIL * max(quality.offset_conflict / OFFSET_FREE, quality.sizes_conflict / SIZES_FREE, 1.0)
    strain *= (1.0 + HIDDEN * (1.0 - quality.supported)) * (1.0 + TEXTURED * quality.rough)
    known = np.linalg.inv(posterior * strain + beside) + np.diag(3.0 / half_ranges**2)
    covariance = np.linalg.inv(known)
    return np.asarray(0.5 * (covariance + covariance.T))
