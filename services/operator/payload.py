"""What every contact made from here begins with: an arm that knows what hangs on its sensor."""

from __future__ import annotations

from crosspih_common.keys import FT_CALIBRATION, SET_PAYLOAD
from crosspih_common.messages import SetPayload
from services.operator.session import Session


def use_payload(session: Session) -> None:
    """Tell the arm what the last calibration found; calibrate where there was none."""
    calibration = session.bus.latest(FT_CALIBRATION).wait_for(lambda latest: latest.calibrated, 10.0)
    if calibration is None:
        calibration = session.calibrate_ft(0.25)
    session.bus.call(
        SET_PAYLOAD,
        SetPayload(
            bias=calibration.bias,
            weight_n=calibration.weight_n,
            centroid_ft_m=calibration.centroid_m,
            gravity_base=calibration.gravity_base,
        ),
        10.0,
    )
