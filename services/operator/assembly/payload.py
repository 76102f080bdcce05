"""What every contact made from here begins with: an arm that is held, and knows what hangs on its sensor."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from crosspih_common.holding import ArmLease, hold_arm
from crosspih_common.keys import FT_CALIBRATION, SET_PAYLOAD
from crosspih_common.messages import ResetCell, SetPayload
from services.operator.assembly.session import Session


@contextmanager
def ready_arm(session: Session, purpose: str) -> Iterator[ArmLease]:
    """Hold the arm of a simulated cell for a block, at home and told what the last calibration found.

    It is calibrated where it never was.

    Raises CommandRefused `held`, and as `Bus.call`.
    """
    calibration = session.bus.latest(FT_CALIBRATION).wait_for(lambda latest: latest.calibrated, 10.0)
    if calibration is None:
        calibration = session.calibrate_ft(0.25)
    with hold_arm(session.bus, purpose) as lease:
        # a payload is judged by what the sensor reads at rest: not while the last contact still presses
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
