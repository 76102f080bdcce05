"""The simulated cell is told what hangs behind its sensor, as `crosspih calibrate ft` tells it."""

from crosspih_common.messages import SetPayload
from services.hardware.drivers.simulated.config import SimulatedSensorConfig
from services.hardware.hosting import HostedCell


def know_payload(cell: HostedCell, sensor: SimulatedSensorConfig) -> None:
    """What `sensor` really has behind it."""
    cell.arm.set_payload(
        SetPayload(
            bias=sensor.bias,
            weight_n=9.81 * sensor.payload_kg,
            centroid_ft_m=sensor.payload_centroid_m,
            gravity_base=(0.0, 0.0, -1.0),
        )
    )
