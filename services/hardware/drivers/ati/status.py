"""The status word that comes with every record, in words.

Two tables: of the Net F/T box (ATI 9620-05-NET FT, "System status code") and of the Ethernet Axia (ATI 9610-05-Ethernet
Axia, "Status code"). The same bit means something else in either.
"""

from __future__ import annotations

from dataclasses import dataclass

ANY_ERROR = 1 << 31

NET_FT = {
    30: "CPU or RAM error",
    29: "digital board error",
    28: "analog board error",
    27: "serial link between the boards fails",
    26: "program memory is wrong",
    25: "halted: its configuration is wrong",
    24: "its settings are not valid",
    23: "configuration and calibration do not fit each other",
    22: "network failure",
    21: "CAN error",
    20: "RDT error",
    19: "EtherNet/IP failure",
    18: "DeviceNet failure",
    17: "transducer saturated, or its A/D converter fails",
    16: "a monitor condition is latched",
    14: "watchdog time-out",
    13: "stack check error",
    12: "EEPROM failure",
    11: "flash memory failure",
    10: "watchdog time-out of the analog board",
    9: "too much current through the strain gages",
    8: "too little current through the strain gages",
    7: "artificial analog ground out of range",
    6: "supply of the analog board too high",
    5: "supply of the analog board too low",
    4: "no data from the analog board",
    3: "reference voltage or supply wrong",
    2: "internal temperature out of range",
    1: "HTTP failure",
}
AXIA = {
    30: "force or torque out of range",
    29: "the calibration's checksum is wrong",
    28: "simulated error",
    27: "a strain gage is out of range",
    26: "a strain gage is nearly out of range",
    16: "a monitor condition is latched",
    7: "its calibration cannot be read",
    5: "common error",
    3: "busy: filter, calibration or rate is being changed",
    2: "a strain gage is broken",
    1: "supply voltage out of range",
    0: "internal temperature out of range",
}
# more load than the numbers can show: they are passed on as they are, so that the caps see them
OVERLOAD = {"net_ft": 1 << 17, "axia": 1 << 30 | 1 << 27}
# of communication, monitoring and filters: the numbers are what they should be
HARMLESS = {
    "net_ft": 1 << 22 | 1 << 21 | 1 << 20 | 1 << 19 | 1 << 18 | 1 << 16 | 1 << 1,
    "axia": 1 << 26 | 1 << 16 | 1 << 3,
}


@dataclass(frozen=True, slots=True)
class StatusVerdict:
    """What a status word says: in words, and whether its record is to be believed."""

    text: str
    overload: bool
    believed: bool


def judge(status: int, table: str) -> StatusVerdict:
    """Of a status word and the name of its table, net_ft or axia. A bit that no table has is not believed."""
    names = NET_FT if table == "net_ft" else AXIA
    said = [names.get(bit, f"bit {bit}") for bit in range(30, -1, -1) if status >> bit & 1]
    overload = bool(status & OVERLOAD[table])
    bad = status & ~(OVERLOAD[table] | HARMLESS[table] | ANY_ERROR)
    if status == ANY_ERROR:
        said, bad = ["an error that it does not name"], status
    return StatusVerdict(f"{', '.join(said) or 'healthy'} (status 0x{status:08X})", overload, not bad)
