"""Preparation of every contact that is made from here: the arm is held, and the payload on its sensor is known."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from crosspih_common.holding import ArmLease, hold_arm
from crosspih_common.keys import FT_CALIBRATION, SET_PAYLOAD
from crosspih_common.messages import ResetCell, SetPayload
from services.operator.assembly.session import Session


@contextmanager
def ready_arm(session: Session, purpose: str) -> Iterator[ArmLease]:
    """Hold the arm of a simulated cell for a block, at home and with the payload of the last calibration set.

    A cell that was never calibrated is calibrated first.

    Raises CommandRefused `held`, and as `Bus.call`.
    """
    calibration = session.bus.latest(FT_CALIBRATION).wait_for(lambda latest: latest.calibrated, 10.0)
    if calibration is None:
        calibration = session.calibrate_ft(0.25)
    with hold_arm(session.bus, purpose) as lease:
        # the payload is checked against the sensor at rest: not while the last contact still presses
        session.new_trial(ResetCell(seed=0))
        lease.ask(
            SET_PAYLOAD,
            SetPayload(
                bias=calibration.bias,
                weight_n=calibration.weight_n,
                centroid_ft_m=calibration.centroid_m,
                gravity_base=calibration.gravity_base,
            ),
            10.0,
        )
        yield lease
