"""From a wrench to a contact state, by the requested classifier."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import ContactClassifier, ContactState
from crosspih_common.shapes import CrossPeg
from services.force_torque.contact_likelihood import LikelihoodClassifier
from services.force_torque.contact_state import ClassifierSettings, ContactStateResult, classify_contact

MIN_FORCE_SD_N = 1e-3
MIN_MOMENT_SD_NM = 1e-4


class Judge:
    """Both classifiers of one cell. For a peg that is no cross there is only the rule."""

    def __init__(self, workcell: Workcell, default: ContactClassifier) -> None:
        self._settings = ClassifierSettings(friction=workcell.friction_expected)
        cross = isinstance(workcell.peg.shape(), CrossPeg)
        self._likelihood = LikelihoodClassifier.of(workcell) if cross else None
        self._default = default if cross else ContactClassifier.RULE

    def __call__(
        self, wrench_peg: Array, wrench_sd: Array | None = None, classifier: ContactClassifier | None = None
    ) -> ContactState:
        """The state of a compensated wrench (6,), peg frame, N and Nm, with its standard deviations (6,)."""
        chosen = self._default if classifier is None else classifier
        settings = self._settings
        if wrench_sd is not None:
            settings = replace(
                settings,
                force_sd_n=max(float(np.mean(wrench_sd[:3])), MIN_FORCE_SD_N),
                moment_sd_nm=max(float(np.mean(wrench_sd[3:])), MIN_MOMENT_SD_NM),
            )
        if chosen is ContactClassifier.RULE or self._likelihood is None:
            return _message(classify_contact(wrench_peg, settings), ContactClassifier.RULE)
        sd = np.repeat([settings.force_sd_n, settings.moment_sd_nm], 3) if wrench_sd is None else wrench_sd
        return _message(self._likelihood.classify(wrench_peg, sd), ContactClassifier.LIKELIHOOD)


def _message(found: ContactStateResult, classifier: ContactClassifier) -> ContactState:
    row = found.state
    return ContactState(
        case=None if row is None else row.name,
        count=None if row is None else row.count,
        sense=None if row is None else row.sense,
        n_z0=min(max(abs(found.n_z0), 0.0), 1.0),
        confidence=min(max(found.confidence, 0.0), 1.0),
        reason=found.reason,
        classifier=classifier,
    )
