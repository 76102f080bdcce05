"""The box's own page, netftapi2.xml: counts per unit, units, rates, calibration. Reading it is pure; fetching is not.

Names of the fields are those of the Net F/T manual (ATI 9620-05-NET FT, "Configuration and calibration access by XML")
and of the Ethernet Axia's (9610-05-Ethernet Axia), which spells some otherwise (`commrdtrate`, `setrate`).
"""

from __future__ import annotations

import http.client
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from crosspih_common.errors import ConfigError

PATH = "/netftapi2.xml"
LARGEST = 256 * 1024  # bytes; real ones have 3 to 6 kB

LBF_N, KGF_N, INCH_M, FOOT_M = 4.4482216152605, 9.80665, 0.0254, 0.3048
NEWTONS = {"n": 1.0, "kn": 1e3, "lbf": LBF_N, "klbf": 1e3 * LBF_N, "kgf": KGF_N, "gf": 1e-3 * KGF_N}
NEWTON_METRES = {
    "nm": 1.0, "nmm": 1e-3, "knm": 1e3, "lbfin": LBF_N * INCH_M, "lbfft": LBF_N * FOOT_M, "kgfcm": KGF_N * 0.01,
    "kgcm": KGF_N * 0.01,
}  # fmt: skip


class PageUnreadable(ConfigError):
    """The page does not come, or does not say what must be known. Raised when opening; the reason of a reconnection."""


@dataclass(frozen=True, slots=True)
class BoxPage:
    """What of the page matters: how counts become N and Nm, how fast they come, and whose they are."""

    product: str
    firmware: str
    calibration: str
    configuration: str
    n_per_count: float
    nm_per_count: float
    units: str
    rdt_rate_hz: float | None
    internal_rate_hz: float | None
    rdt_enabled: bool
    status: int
    ratings: tuple[float, ...]  # of Fx, Fy, Fz, N, and Tx, Ty, Tz, Nm; empty where not told
    transformation: tuple[float, ...]  # by which the box moves the wrench to another point: its tool transformation
    bias: tuple[float, ...]  # the software bias that the box takes off, of its six gages

    @property
    def axia(self) -> bool:
        """Whether it is an Ethernet Axia, whose status word is another one than a Net F/T's."""
        return "axia" in self.product.lower()

    def same_numbers(self, other: BoxPage) -> bool:
        """Whether its counts still mean the same wrench."""
        return all(
            getattr(self, name) == getattr(other, name)
            for name in ("calibration", "n_per_count", "nm_per_count", "transformation", "bias")
        )


def fetch_page(host: str, port: int, timeout_s: float) -> str:
    """The page as it comes. Raises PageUnreadable with the mend."""
    connection = http.client.HTTPConnection(host, port, timeout=timeout_s)
    where = f"http://{host}:{port}{PATH}"
    try:
        connection.request("GET", PATH)
        reply = connection.getresponse()
        body = reply.read(LARGEST + 1)
    except (OSError, http.client.HTTPException) as error:
        raise PageUnreadable(
            f"hardware.ati.host: {where} does not answer ({error or type(error).__name__}); is the box powered, and is "
            "this machine in its network? Look with a browser, or ping it"
        ) from None
    finally:
        connection.close()
    if reply.status != 200 or len(body) > LARGEST:
        raise PageUnreadable(
            f"hardware.ati.host: {where} answers with status {reply.status} and {len(body)} bytes: is it an ATI box?"
        )
    return body.decode("utf-8", errors="replace")


def read_page(text: str) -> BoxPage:
    """What the page says. Raises PageUnreadable naming the field."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise PageUnreadable("hardware.ati: the page declares entities, which an ATI box never does")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise PageUnreadable(f"hardware.ati: the page is no XML ({error}); is it an ATI box?") from None
    fields = {element.tag.rsplit("}", 1)[-1]: (element.text or "").strip() for element in root.iter()}
    force, torque = _unit(fields, "scfgfu", NEWTONS), _unit(fields, "scfgtu", NEWTON_METRES)
    ratings = _numbers(fields.get("cfgmr", ""))
    in_units = (force,) * 3 + (torque,) * 3
    return BoxPage(
        product=fields.get("prodname", ""),
        firmware=fields.get("mfgdigver", ""),
        calibration=fields.get("cfgcalsn", fields.get("calsn", "")),
        configuration=fields.get("cfgnam", ""),
        n_per_count=force / _counts(fields, "cfgcpf"),
        nm_per_count=torque / _counts(fields, "cfgcpt"),
        units=f"{fields['scfgfu']}, {fields['scfgtu']}",
        rdt_rate_hz=_rate(fields, "comrdtrate", "commrdtrate"),
        internal_rate_hz=_rate(fields, "runrate", "setrate"),
        rdt_enabled=fields.get("comrdte", "Enabled").lower() not in ("disabled", "0"),
        status=_status(fields.get("runstat", "0")),
        ratings=tuple(one * unit for one, unit in zip(ratings, in_units, strict=True)) if len(ratings) == 6 else (),
        transformation=_numbers(fields.get("cfgtfx", "")),
        bias=_numbers(fields.get("setbias", "")),
    )


def _unit(fields: dict[str, str], name: str, known: dict[str, float]) -> float:
    said = fields.get(name, "")
    unit = known.get(said.lower().replace("-", "").replace(" ", ""))
    if unit is None:
        raise PageUnreadable(
            f"hardware.ati: the page's {name} is {said!r}, a unit that is not known here; choose N and N-m on the "
            "box's Configurations page"
        )
    return unit


def _counts(fields: dict[str, str], name: str) -> float:
    try:
        counts = float(fields.get(name, ""))
    except ValueError:
        counts = math.nan
    if not (math.isfinite(counts) and counts > 0.0):
        raise PageUnreadable(
            f"hardware.ati: the page's {name} is {fields.get(name, '')!r}, want counts per unit above 0"
        )
    return counts


def _rate(fields: dict[str, str], *names: str) -> float | None:
    for name in names:
        try:
            rate = float(fields.get(name, ""))
        except ValueError:
            continue
        if 0.0 < rate <= 100_000.0:
            return rate
    return None


def _status(said: str) -> int:
    try:
        return int(said, 0) & 0xFFFFFFFF
    except ValueError:
        return 0


def _numbers(said: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in said.replace(",", ";").split(";") if part.strip())
    except ValueError:
        return ()
