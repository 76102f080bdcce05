"""Wrenches that no wrist sensor can feel are refused by their field, before anything is computed with them."""

from __future__ import annotations

import pytest

from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused
from crosspih_common.messages import ClassifyContacts, ContactClassifier
from services.force_torque.answering import classified
from services.force_torque.judging import Judge

TOUCH = (0.0, 2.0, -10.0, 0.3, 0.0, 0.0)
SD = (0.1, 0.1, 0.1, 0.01, 0.01, 0.01)


@pytest.mark.parametrize("classifier", list(ContactClassifier))
@pytest.mark.parametrize("absurd", [5e8, -1e9])
def test_what_no_sensor_can_feel_is_not_classified(classifier: ContactClassifier, absurd: float) -> None:
    judge = Judge(load_cell("deploy/cells/default.yaml").workcell, classifier)
    beyond = (0.0, 0.0, absurd, 0.0, 0.0, 0.0)
    for name, wrenches, sds in (
        ("wrenches.1: .* at most 100000 N", (TOUCH, beyond), (SD, SD)),
        ("wrench_sds.0: .* at most 100000 N", (TOUCH, TOUCH), (tuple(map(abs, beyond)), SD)),
    ):
        with pytest.raises(CommandRefused, match=name) as refusal:
            classified(judge, ClassifyContacts(wrenches=wrenches, wrench_sds=sds, classifier=classifier))
        assert refusal.value.code == "implausible"
