"""Opens the sensor: whatever would make its numbers wrong is said now, with the setting and the mend."""

from __future__ import annotations

import sys
import time

import numpy as np

from crosspih_common.errors import ConfigError
from crosspih_common.messages import Severity
from services.hardware.drivers.ati.config import AtiConfig
from services.hardware.drivers.ati.device import AtiWrench
from services.hardware.drivers.ati.page import BoxPage, fetch_page, read_page
from services.hardware.drivers.ati.rdt import ROLL, SET_BIAS, START_REALTIME, RdtSocket
from services.hardware.drivers.ati.status import judge
from services.hardware.drivers.registry import OpenRequest
from services.hardware.protocols import Devices

LOOK_S = 1.3  # at the stream before it is believed: a span of the clock, and some
SAME_RATE = 0.05
COMMUNICATIONS = "RDT Output Rate on the box's Communications page"


def open_devices(request: OpenRequest) -> Devices:
    """The sensor of `hardware.ati`. Raises ConfigError naming the field and the mend."""
    config = request.config.ati
    if others := sorted(request.wanted - {"force_torque"}):
        raise ConfigError(
            f"hardware.driver: ati opens no {others[0]}; name it for the sensor alone: drivers: {{force_torque: ati}}"
        )
    if config is None:
        raise ConfigError("hardware.ati: says nothing; give at least its address: ati: {host: 192.168.1.1}")
    if not request.realtime:
        raise ConfigError("hardware.ati: a real sensor needs a cell that runs in real time: --speed realtime")
    page = read_page(fetch_page(config.host, config.http_port, config.timeout_s))
    table = config.status_table if config.status_table != "auto" else "axia" if page.axia else "net_ft"
    _check_page(config, page, table, request)
    try:
        link = RdtSocket(config.host, config.rdt_port)
    except OSError as error:
        raise ConfigError(f"hardware.ati.host: {config.host} is no address that can be reached ({error})") from None
    try:
        wrench = _look(config, page, table, link, request)
    except BaseException:
        link.close()
        raise
    print(
        f"force/torque: ATI {page.product or 'Net F/T'} {config.host}, calibration {page.calibration or '?'}, "
        f"{1.0 / wrench.period_s:.0f} a second, stamps within {wrench.clock.uncertainty_s * 1e3:.2f} ms",
        file=sys.stderr,
        flush=True,
    )
    return Devices(wrench=wrench, realtime=True, host_stamped=True, close=wrench.close)


def _check_page(config: AtiConfig, page: BoxPage, table: str, request: OpenRequest) -> None:
    sensor, limits = request.workcell.force_torque, request.config.limits
    for field, unit, own in (("force_unit", sensor.force_unit, "N"), ("moment_unit", sensor.moment_unit, "Nm")):
        if unit != own:
            raise ConfigError(
                f"cell.force_torque.{field}: {unit}, but the driver ati makes N and Nm of the box's {page.units}; "
                "leave it out"
            )
    if not page.rdt_enabled:
        raise ConfigError("hardware.ati: RDT is switched off; enable it on the box's Communications page")
    if config.calibration is not None and config.calibration != page.calibration:
        raise ConfigError(
            f"hardware.ati.calibration: {config.calibration} must be in use, and the box uses "
            f"{page.calibration or 'another'}; choose it on the box's Configurations page, or say so here and calibrate"
        )
    verdict = judge(page.status, table)
    if not verdict.believed or verdict.overload:
        raise ConfigError(
            f"hardware.ati: the sensor says: {verdict.text}; take all load off it, look at its cable and supply, power "
            "it up anew"
        )
    if page.ratings:
        for name, cap, rated, unit in (
            ("force_cap_n", limits.force_cap_n, min(page.ratings[:3]), "N"),
            ("moment_cap_nm", limits.moment_cap_nm, min(page.ratings[3:]), "Nm"),
        ):
            if cap > rated > 0.0:
                raise ConfigError(
                    f"hardware.limits.{name}: {cap:g} {unit}, and the sensor measures {rated:g} {unit} in this "
                    "calibration: it would never feel the cap; lower it, or choose a larger calibration on the box"
                )
    if any(page.transformation):
        request.tell(
            Severity.WARNING,
            "tool_transformation",
            "the ATI box moves its wrench by a tool transformation: cell.force_torque.pose_flange_sensor must be where "
            "that leads to; none is simpler (Configurations page, all zero)",
        )
    if any(page.bias):
        request.tell(
            Severity.INFO,
            "software_bias",
            "the ATI box takes off a software bias that was set before; `crosspih calibrate ft` finds what is left",
        )


def _look(config: AtiConfig, page: BoxPage, table: str, link: RdtSocket, request: OpenRequest) -> AtiWrench:
    """Start the stream and look at it for a while: does it come, how fast, and does its sequence say the same?"""
    link.send(START_REALTIME)
    if config.bias:
        link.send(SET_BIAS)
    rdt: list[int] = []
    ft: list[int] = []
    arrived: list[int] = []
    until_s = time.monotonic() + config.timeout_s
    while time.monotonic() < until_s:
        got = link.receive()
        if len(got.records):
            if not rdt:
                until_s = time.monotonic() + LOOK_S
            rdt += got.records["rdt"].tolist()
            ft += got.records["ft"].tolist()
            arrived += got.arrived_ns.tolist()
        time.sleep(0.002)
    if len(rdt) < 10:
        raise ConfigError(
            f"hardware.ati.rdt_port: the page at {config.host} answers, but to a request on UDP port {config.rdt_port} "
            f"{len(rdt)} records came; a firewall on this machine, or another program that has the stream?"
        )
    seconds = (arrived[-1] - arrived[0]) * 1e-9
    rate_hz = ((rdt[-1] - rdt[0]) % ROLL) / seconds
    step = int(np.median(np.diff(np.array(ft, dtype=np.uint32))))
    period_s, internal_hz = _period_s(config, page, rate_hz, step)
    timeout_s = request.config.limits.sensor_timeout_s
    if period_s > 0.5 * timeout_s:
        raise ConfigError(
            f"hardware.ati: one record every {period_s * 1e3:.0f} ms, and the arm stops after {timeout_s * 1e3:.0f} ms "
            f"without one (hardware.limits.sensor_timeout_s); raise {COMMUNICATIONS} to 500 or more"
        )
    if page.rdt_rate_hz is not None and abs(period_s * page.rdt_rate_hz - 1.0) > SAME_RATE:
        request.tell(
            Severity.WARNING,
            "rate_differs",
            f"the ATI box's page says {page.rdt_rate_hz:g} records a second, {1.0 / period_s:.0f} come",
        )
    if config.bias:  # the page tells it now
        page = read_page(fetch_page(config.host, config.http_port, config.timeout_s))
    wrench = AtiWrench(config, page, link, internal_hz, period_s, table, request.tell)
    for count, arrived_ns in zip(ft, arrived, strict=True):
        wrench.clock.observe(count / internal_hz, arrived_ns)
    wrench.forget_stream()
    return wrench


def _period_s(config: AtiConfig, page: BoxPage, rate_hz: float, step: int) -> tuple[float, float]:
    """The time between two records by the sensor's own sequence, and the rate of that, Hz; refused where it is not what
    comes, or not what was asked for."""
    internal_hz = config.internal_rate_hz or page.internal_rate_hz
    seems = f"it seems to be {rate_hz * step:.0f}"
    if internal_hz is None:
        raise ConfigError(
            "hardware.ati.internal_rate_hz: the page does not say how fast the sensor samples; give it: 7000 for a Net "
            f"F/T ({seems})"
        )
    if abs(rate_hz * step / internal_hz - 1.0) > SAME_RATE:
        raise ConfigError(
            f"hardware.ati.internal_rate_hz: {internal_hz:g} is said, but {rate_hz:.0f} records a second come that are "
            f"{step} samples apart: {seems}; give that"
        )
    period_s = step / internal_hz
    if config.rate_hz is not None and abs(period_s * config.rate_hz - 1.0) > SAME_RATE:
        raise ConfigError(
            f"hardware.ati.rate_hz: {config.rate_hz} is wanted, the box sends {1.0 / period_s:.0f} a second; set "
            f"{COMMUNICATIONS} (a Net F/T has whole fractions of 7000), or say so here"
        )
    return period_s, internal_hz
