"""A recorded topic as a pandas table: rows are samples, columns their fields with the unit in the name.

- `t_s` is cell time since the recording began, `stamp_ns` the cell's clock itself, `seq` the sample's number; for
  topics that every service has, `service` names the service.
- A wrench is `force_x_n`, `force_y_n`, `force_z_n`, `moment_x_nm`, ...; any other field of six such numbers has its
  name before that (`wrench_sd_force_x_n`). A position is `pose_base_peg_x_m`, ..., a rotation
  `pose_base_peg_quaternion_x`, ..., a joint `joint_1_rad`, ... from the base, another vector `<name>_x_<unit>`.
- A batch of samples (`ft/raw`) is a row a sample, each at its own time, with `channel_1` ... `channel_6` in the
  sensor's own units, axes and sign.
- Longer lists (covariances, row by row) and lists of parts stay one column of objects. A picture is a row with its
  pixels as an array.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any

from crosspih_common.errors import ConfigError
from crosspih_common.keys import CLOCK, Topic
from crosspih_common.messages import Image, Message
from crosspih_common.topic_names import EVERY_SERVICE, topic_named

if TYPE_CHECKING:
    import pandas

    from crosspih_common.recording.reader import Recording, Sent

UNITS = (
    *("m_s3", "m_s2", "m_s", "rad_s2", "rad_s", "nm_rad", "n_m", "n_s"),
    *("nm", "rad", "deg", "mm", "ns", "px", "m", "n", "s"),
)
WRENCHES = ("wrench", "bias", "filtered", "free_mean", "run_wrench")
AXES = ("x", "y", "z")
WRENCH_PARTS = ("force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm")
PANDAS = "pandas is not installed, and a table needs it: pip install 'crosspih[client]'"


def table_of(recording: Recording, topic: Topic[Any] | str) -> pandas.DataFrame:
    """The table of a topic. Raises ConfigError without pandas, and for a topic that is not there."""
    try:
        import pandas
    except ModuleNotFoundError:
        raise ConfigError(PANDAS) from None
    row = topic_named(topic)
    sent = recording.sent(row)
    if not sent:
        raise ConfigError(f"{row.path}: not in {recording.path}; it has {', '.join(recording.topics())}")
    begun = _begun_ns(recording)
    of_all = EVERY_SERVICE in row.path
    rows: list[dict[str, Any]] = []
    for one in sent:
        rows += _rows(one, begun, _service_of(one.key, row) if of_all else None)
    rows.sort(key=lambda entry: entry["stamp_ns"])  # of several services, one after the other in time
    table = pandas.DataFrame.from_records(rows)
    # a part that only some rows have: its fields become columns of their own
    parts = [
        name for name in table if table[name].isna().all() and any(other.startswith(f"{name}_") for other in table)
    ]
    return table.drop(columns=parts)


def _service_of(key: str, topic: Topic[Any]) -> str:
    return key.split("/")[2:][topic.path.split("/").index(EVERY_SERVICE)]


def _begun_ns(recording: Recording) -> int:
    ticks = [sample.stamp_ns for key in recording.keys_of(CLOCK) for sample in recording.samples[key]]
    return ticks[0] if ticks else recording.span_ns()[0]


def _rows(sent: Sent[Any], begun_ns: int, service: str | None) -> Iterator[dict[str, Any]]:
    value: Message | Image = sent.value
    about: dict[str, Any] = {
        "t_s": (value.stamp_ns - begun_ns) * 1e-9, "stamp_ns": value.stamp_ns, "seq": value.seq,
    }  # fmt: skip
    if service is not None:
        about["service"] = service
    if isinstance(value, Image):
        yield about | {"frame": value.frame, "encoding": value.encoding, "pixels": value.pixels}
        return
    fields = value.model_dump()
    samples, period_ns = fields.get("samples"), fields.get("period_ns")
    if samples is None or period_ns is None:
        yield about | dict(_columns(fields, ""))
        return
    rest = dict(_columns({name: field for name, field in fields.items() if name != "samples"}, ""))
    for index, sample in enumerate(samples):
        stamp_ns = value.stamp_ns + index * period_ns
        at = {"t_s": (stamp_ns - begun_ns) * 1e-9, "stamp_ns": stamp_ns}
        yield about | at | rest | {f"channel_{number}": entry for number, entry in enumerate(sample, 1)}


def _columns(fields: Mapping[str, Any], before: str) -> Iterator[tuple[str, Any]]:
    for name, field in fields.items():
        if not before and name in ("stamp_ns", "seq"):
            continue
        if isinstance(field, Mapping):
            if "position_m" in field and "quaternion_xyzw" in field:
                yield from _columns(field, f"{before}{name}_")
            elif field and all(isinstance(entry, (int, float)) for entry in field.values()):
                yield from ((f"{before}{name}_{inner}", entry) for inner, entry in field.items())
            else:
                yield from _columns(field, f"{before}{name}_")
        elif isinstance(field, (tuple, list)) and field and all(isinstance(entry, (int, float)) for entry in field):
            yield from _vector(before, name, field)
        else:
            yield f"{before}{name}", field.value if isinstance(field, Enum) else field


def _vector(before: str, name: str, numbers: Sequence[float]) -> Iterator[tuple[str, Any]]:
    base, unit = _unit_of(name)
    if name == "position_m":
        yield from ((f"{before}{axis}_m", number) for axis, number in zip(AXES, numbers, strict=True))
    elif name == "quaternion_xyzw":
        yield from ((f"{before}quaternion_{axis}", number) for axis, number in zip("xyzw", numbers, strict=True))
    elif unit.startswith("rad") and len(numbers) in (6, 7) and base.endswith("s"):
        yield from ((f"{before}{base[:-1]}_{index}_{unit}", number) for index, number in enumerate(numbers, 1))
    elif len(numbers) == 6 and (name in WRENCHES or name.startswith("wrench")):
        own = before if name == "wrench" else f"{before}{name}_"
        yield from ((f"{own}{part}", number) for part, number in zip(WRENCH_PARTS, numbers, strict=True))
    elif len(numbers) == 3:
        tail = f"_{unit}" if unit else ""
        yield from ((f"{before}{base}_{axis}{tail}", number) for axis, number in zip(AXES, numbers, strict=True))
    else:
        yield f"{before}{name}", tuple(numbers)


def _unit_of(name: str) -> tuple[str, str]:
    """(name without its unit, unit); no unit where the name has none."""
    unit = next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")
    return (name.removesuffix(f"_{unit}"), unit) if unit else (name, "")
