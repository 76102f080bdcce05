"""What the rendered camera says of itself: a GenICam description (GenApi 1.0, names of SFNC) over plain registers.

The library's fake camera keeps 64 KiB of registers and minds some of them itself: size, format, exposure, gain, trigger
(aravis, src/arvfakecamera.h). All others are this file's, above 0x8000, and are read by `genicam.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

WIDTH, HEIGHT, GAIN, SENSOR_HEIGHT, SENSOR_WIDTH = 0x100, 0x104, 0x110, 0x118, 0x11C
EXPOSURE_US, ACQUISITION, PIXEL_FORMAT, ACQUISITION_MODE, OFFSET_X, OFFSET_Y = 0x120, 0x124, 0x128, 0x12C, 0x130, 0x134
# the library draws a picture when SEND is written: `genicam.py` writes it when a triggered picture is rendered
TRIGGER_MODE, MINDED_SOURCE, TRIGGER_ACTIVATION, SEND = 0x300, 0x304, 0x308, 0x30C
LINE_SELECTOR, LINE_MODE, LINE_INVERTER, LINE_SOURCE = 0x8000, 0x8010, 0x8030, 0x8050
OUTPUT_SELECTOR, OUTPUT_VALUE = 0x8070, 0x8080
TRIGGERED, TRIGGER_SELECTOR = 0x80D0, 0x80C0
PTP_ENABLE, PTP_STATUS, TEMPERATURE, TRIGGER_SOURCE, LATCH, LATCHED = 0x80A0, 0x80A4, 0x80A8, 0x80AC, 0x80B0, 0x80B8

FORMATS = {
    "Mono8": 0x01080001, "Mono10": 0x01100003, "Mono12": 0x01100005, "Mono16": 0x01100007, "RGB8": 0x02180014,
    "BayerGR8": 0x01080008, "BayerRG8": 0x01080009, "BayerGB8": 0x0108000A, "BayerBG8": 0x0108000B,
    "BayerRG12": 0x01100011,
}  # fmt: skip
LINES = tuple(f"Line{number}" for number in range(1, 7))
OUTPUTS = tuple(f"UserOutput{number}" for number in range(4))
SOURCES = ("Off", *OUTPUTS, "ExposureActive")
SOFTWARE = 1  # of TRIGGER_SOURCE; Line4 is 4
TRIGGER_SOURCES = {"Software": SOFTWARE, "Line4": 4, "Line5": 5}
PTP_SLAVE = 9
GAIN_STEP_DB = 0.1
LONGEST_US = 8_000_000


def description() -> str:
    """The XML that the camera gives out."""
    features = [
        _string("DeviceVendorName", 0x48, 32), _string("DeviceModelName", 0x68, 32),
        _string("DeviceSerialNumber", 0xD8, 16), _string("DeviceID", 0xD8, 16),
        _integer("SensorWidth", SENSOR_WIDTH, access="RO"), _integer("SensorHeight", SENSOR_HEIGHT, access="RO"),
        _integer("Width", WIDTH, 16, "SensorWidth", 4), _integer("Height", HEIGHT, 16, "SensorHeight", 2),
        _integer("OffsetX", OFFSET_X, 0, "SensorWidth", 4), _integer("OffsetY", OFFSET_Y, 0, "SensorHeight", 2),
        _enumeration("PixelFormat", PIXEL_FORMAT, FORMATS),
        _command("AcquisitionStart", "AcquisitionRegister", 1), _command("AcquisitionStop", "AcquisitionRegister", 0),
        _register("AcquisitionRegister", ACQUISITION, "WO"),
        _enumeration("AcquisitionMode", ACQUISITION_MODE, {"Continuous": 1, "SingleFrame": 2, "MultiFrame": 3}),
        _enumeration("TriggerSelector", TRIGGER_SELECTOR, {"FrameStart": 0}),
        _enumeration("TriggerMode", TRIGGER_MODE, {"Off": 0, "On": 1}),
        _enumeration("TriggerSource", TRIGGER_SOURCE, TRIGGER_SOURCES),
        _enumeration("TriggerActivation", TRIGGER_ACTIVATION, {"RisingEdge": 0}),
        _command("TriggerSoftware", "TriggerSoftwareRegister", 1),
        _register("TriggerSoftwareRegister", TRIGGERED, "WO"),
        _scaled("ExposureTime", EXPOSURE_US, 1.0, 20.0, LONGEST_US), _scaled("Gain", GAIN, GAIN_STEP_DB, 0.0, 24.0),
        _scaled("DeviceTemperature", TEMPERATURE, 0.1, -50.0, 150.0, access="RO"),
        _enumeration("LineSelector", LINE_SELECTOR, {name: index for index, name in enumerate(LINES)}),
        _enumeration("LineMode", LINE_MODE, {"Input": 0, "Output": 1}, index="LineSelectorRegister"),
        _boolean("LineInverter", LINE_INVERTER, index="LineSelectorRegister"),
        _enumeration("LineSource", LINE_SOURCE, {name: index for index, name in enumerate(SOURCES)},
                     index="LineSelectorRegister"),
        _enumeration("UserOutputSelector", OUTPUT_SELECTOR, {name: index for index, name in enumerate(OUTPUTS)}),
        _boolean("UserOutputValue", OUTPUT_VALUE, index="UserOutputSelectorRegister"),
        _boolean("PtpEnable", PTP_ENABLE),
        _enumeration("PtpStatus", PTP_STATUS, {"Disabled": 3, "Listening": 4, "Master": 6, "Slave": PTP_SLAVE}),
        _command("TimestampLatch", "TimestampLatchRegister", 1), _register("TimestampLatchRegister", LATCH, "WO"),
        _integer("TimestampLatchValue", LATCHED, length=8, access="RO"),
        _PAYLOAD,
    ]  # fmt: skip
    public = [name for name in _NAMES if not name.endswith("Register")]
    return (
        _HEAD
        + _category(public)
        + "".join(features)
        + '<Port Name="Device" NameSpace="Standard"/></RegisterDescription>'
    )


_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Rendered" VendorName="crosspih" StandardNameSpace="None" SchemaMajorVersion="1"
 SchemaMinorVersion="0" SchemaSubMinorVersion="1" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ToolTip="Rendered camera" ProductGuid="0" VersionGuid="0" xmlns="http://www.genicam.org/GenApi/Version_1_0">
"""
_PAYLOAD = """<IntSwissKnife Name="PayloadSize" NameSpace="Standard"><pVariable Name="W">Width</pVariable>
<pVariable Name="H">Height</pVariable><pVariable Name="F">PixelFormatRegister</pVariable>
<Formula>W * H * ((F &gt;&gt; 16) &amp; 0xFF) / 8</Formula></IntSwissKnife>
"""
_NAMES = (
    "DeviceVendorName", "DeviceModelName", "DeviceSerialNumber", "DeviceID", "DeviceTemperature", "SensorWidth",
    "SensorHeight", "Width", "Height", "OffsetX", "OffsetY", "PixelFormat", "AcquisitionStart", "AcquisitionStop",
    "AcquisitionMode", "TriggerSelector", "TriggerMode", "TriggerSource", "TriggerActivation", "TriggerSoftware",
    "ExposureTime", "Gain", "LineSelector", "LineMode", "LineInverter", "LineSource", "UserOutputSelector",
    "UserOutputValue", "PtpEnable", "PtpStatus", "TimestampLatch", "TimestampLatchValue", "PayloadSize",
)  # fmt: skip


def _category(names: Sequence[str]) -> str:
    listed = "".join(f"<pFeature>{name}</pFeature>" for name in names)
    return f'<Category Name="Root" NameSpace="Standard">{listed}</Category>\n'


def _register(name: str, address: int, access: str = "RW", length: int = 4, index: str = "") -> str:
    at = f'<pIndex Offset="4">{index}</pIndex>' if index else ""
    return (
        f'<IntReg Name="{name}" NameSpace="Custom"><Address>0x{address:x}</Address>{at}<Length>{length}</Length>'
        f"<AccessMode>{access}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign>"
        "<Endianess>BigEndian</Endianess></IntReg>\n"
    )


def _string(name: str, address: int, length: int) -> str:
    return (
        f'<StringReg Name="{name}" NameSpace="Standard"><Address>0x{address:x}</Address><Length>{length}</Length>'
        "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>\n"
    )


def _integer(
    name: str, address: int, least: int = 0, most: str = "", step: int = 1, length: int = 4, access: str = "RW"
) -> str:
    limits = f"<Min>{least}</Min><pMax>{most}</pMax><Inc>{step}</Inc>" if most else ""
    return (
        f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>{limits}</Integer>\n'
        + _register(f"{name}Register", address, access, length)
    )


def _enumeration(name: str, address: int, entries: dict[str, int], index: str = "") -> str:
    listed = "".join(
        f'<EnumEntry Name="{entry}" NameSpace="Standard"><Value>{value}</Value></EnumEntry>'
        for entry, value in entries.items()
    )
    return (
        f'<Enumeration Name="{name}" NameSpace="Standard">{listed}<pValue>{name}Register</pValue></Enumeration>\n'
        + _register(f"{name}Register", address, index=index)
    )


def _boolean(name: str, address: int, index: str = "") -> str:
    return (
        f'<Boolean Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue><OnValue>1</OnValue>'
        f"<OffValue>0</OffValue></Boolean>\n" + _register(f"{name}Register", address, index=index)
    )


def _command(name: str, register: str, value: int) -> str:
    return (
        f'<Command Name="{name}" NameSpace="Standard"><pValue>{register}</pValue>'
        f"<CommandValue>{value}</CommandValue></Command>\n"
    )


def _scaled(name: str, address: int, step: float, least: float, most: float, access: str = "RW") -> str:
    return (
        f'<Float Name="{name}" NameSpace="Standard"><pValue>{name}Converter</pValue><Min>{least}</Min><Max>{most}</Max>'
        f'</Float>\n<Converter Name="{name}Converter" NameSpace="Custom"><FormulaTo>FROM / {step}</FormulaTo>'
        f"<FormulaFrom>TO * {step}</FormulaFrom><pValue>{name}Register</pValue></Converter>\n"
        + _register(f"{name}Register", address, access)
    )
