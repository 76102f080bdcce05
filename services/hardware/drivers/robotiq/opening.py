"""Opens the sensor: it must answer, say who it is, and come as often as it is said to."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from crosspih_common.errors import ConfigError
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.robotiq.config import RobotiqConfig
from services.hardware.drivers.robotiq.wire import RANGE_N, RANGE_NM
from services.hardware.protocols import Devices

if TYPE_CHECKING:
    from services.hardware.drivers.robotiq.device import Ft300Wrench, Link

SETTLE_S = 3.0
LOOKS = 20  # questions by which it is found how many a second it answers


def open_devices(request: OpenRequest) -> Devices:
    """The sensor of `hardware.robotiq`. Raises ConfigError naming the field and the mend."""
    config = request.config.robotiq
    if others := sorted(request.wanted - {"force_torque"}):
        raise ConfigError(
            f"hardware.driver: robotiq opens no {others[0]}; name it for the sensor alone: "
            "drivers: {force_torque: robotiq}"
        )
    if config is None:
        raise ConfigError("hardware.robotiq: says nothing; say where it is: robotiq: {serial: /dev/ttyUSB0}")
    if not request.realtime:
        raise ConfigError("hardware.robotiq: a real sensor needs a cell that runs in real time: --speed realtime")
    _check_cell(request)
    try:
        from services.hardware.drivers.robotiq.device import Ft300Wrench, Link, LinkLost
    except ImportError as error:
        raise ConfigError(f'hardware.driver: robotiq needs {error.name}: pip install "crosspih[robotiq]"') from None
    try:
        link = Link(config)
        try:
            link.wrench()
            said = link.identity()
            if not config.streams:
                _check_rate(config, link)
        except BaseException:
            link.close()
            raise
    except LinkLost as error:
        field = "serial" if config.serial is not None else "host"
        raise ConfigError(
            f"hardware.robotiq.{field}: {error}; is the sensor supplied with 24 V, does another program use the line, "
            "may "
            f"this user open it (group dialout), is {config.device_id} its address (device_id)?"
        ) from None
    wrench = Ft300Wrench(config, link, said, request.tell)
    _await_samples(wrench, config)
    print(
        f"force/torque: Robotiq {said}, {1.0 / wrench.period_s:.0f} a second "
        f"({'stream' if config.streams else 'registers'})",
        file=sys.stderr,
        flush=True,
    )
    return Devices(wrench=wrench, realtime=True, host_stamped=True, close=wrench.close)


def _check_cell(request: OpenRequest) -> None:
    sensor, limits = request.workcell.force_torque, request.config.limits
    for field, unit, own in (("force_unit", sensor.force_unit, "N"), ("moment_unit", sensor.moment_unit, "Nm")):
        if unit != own:
            raise ConfigError(f"cell.force_torque.{field}: {unit}, but the driver robotiq tells {own}; leave it out")
    for name, cap, rated, unit in (
        ("force_cap_n", limits.force_cap_n, RANGE_N, "N"),
        ("moment_cap_nm", limits.moment_cap_nm, RANGE_NM, "Nm"),
    ):
        if cap > rated:
            raise ConfigError(
                f"hardware.limits.{name}: {cap:g} {unit}, and the FT 300 measures {rated:g} {unit}: lower it"
            )


def _check_rate(config: RobotiqConfig, link: Link) -> None:
    began_s = time.monotonic()
    for _ in range(LOOKS):
        link.wrench()
    possible_hz = LOOKS / (time.monotonic() - began_s)
    if possible_hz < config.poll_hz:
        raise ConfigError(
            f"hardware.robotiq.poll_hz: {config.poll_hz:g} is wanted, {possible_hz:.0f} answers a second come; ask less"
            + (", or read the stream (mode: stream)" if config.serial is not None else "")
        )


def _await_samples(wrench: Ft300Wrench, config: RobotiqConfig) -> None:
    """Until the first samples are there, and in a stream its clock has settled."""
    until_s = time.monotonic() + SETTLE_S
    while time.monotonic() < until_s:
        clock = wrench.clock
        if wrench.counts.received >= 5 and (not config.streams or (clock is not None and clock.settled)):
            return
        time.sleep(0.01)
    wrench.close()
    raise ConfigError(
        f"hardware.robotiq.mode: the sensor answers, but {wrench.counts.received} samples came in {SETTLE_S:g} s; take "
        "the other mode (stream, poll), and look at its cable"
    )
