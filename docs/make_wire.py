"""Make docs/wire.md from docs/wire.md.j2: tables from keys and messages, numbers from the source that has them.

    python -m docs.make_wire [FILE]

A number is read from its file's text, so that no engine and no driver is imported for the page.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
from enum import Enum
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from crosspih_common import keys, messages
from crosspih_common.bus.authors import MAX_HELD
from crosspih_common.bus.bus import HISTORY, NOW_LANE
from crosspih_common.bus.clock import AHEAD_NS
from crosspih_common.bus.codec import label_of
from crosspih_common.bus.zenoh_transport import ALIVE_BEATS, ALIVE_LEASE_MS, DEFAULT_ENDPOINT, HEARTBEAT_S, LEASE_MS
from crosspih_common.messages import GuardedMove, Message
from crosspih_common.messages.images import ENCODINGS
from crosspih_common.refusals import REFUSALS
from services.operator.assembly.session import NEEDED
from services.operator.contract.keys_table import HEADINGS, rows
from services.operator.contract.schema import image_proto, types
from services.planning.config import PlanningConfig
from services.vision.config import VisionConfig

HERE = Path(__file__).resolve().parent
HARDWARE = HERE.parent / "services" / "hardware"
TEMPLATE = "wire.md.j2"
PAGE = HERE / "wire.md"
ENUM_VALUE = re.compile(r'^\s+\w+ = "(?P<value>[^"]*)"(?:\s+# (?P<meaning>.*))?$', re.MULTILINE)
SERVES = ("serve", "_serve")  # the latter is the arm shell's, for motions
# lanes that depend on what a process hosts
LANES = {"camera/capture": "arm; in a process without the arm one of its own"}
BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<", "maxLength": "length ≤"}
# what the page calls a number: where it may stand (file below services/hardware, name or Class.field), and the factor
# to the page's unit; the first that is there counts
NUMBERS: dict[str, list[tuple[str, str, float]]] = {
    "last_ms": [("control/runner", "LAST_S", 1e3), ("control/servo", "LAST_SAMPLES", 1)],
    "tick_ms": [("control/runner", "TICK_NS", 1e-6), ("control/servo", "TICK_NS", 1e-6)],
    "start_rad": [("control/paths", "START_TOLERANCE_RAD", 1)],
    "settle_ms": [("control/motions", "SETTLE_S", 1e3), ("control/motions", "SETTLE_STEPS", 1)],
    "skip_ms": [("control/guarded", "FREE_SKIP_S", 1e3), ("control/guarded", "FREE_SKIP", 1)],
    "free_ms": [("control/guarded", "FREE_S", 1e3), ("control/guarded", "FREE_SAMPLES", 1)],
    "onset_ms": [("control/guarded", "ONSET_S", 1e3), ("control/guarded", "ONSET_WINDOW", 1)],
    "braking_m_s2": [("control/config", "LimitsConfig.braking_m_s2", 1), ("control/guarded", "BRAKE_M_S2", 1)],
    "retreat_mm_s": [("control/guarded", "_RETREAT_M_S", 1e3)],
    "force_cap_n": [
        ("control/config", "LimitsConfig.force_cap_n", 1),
        ("drivers/simulated/config", "SimulatedConfig.force_cap_n", 1),
    ],
    "moment_cap_nm": [
        ("control/config", "LimitsConfig.moment_cap_nm", 1),
        ("drivers/simulated/config", "SimulatedConfig.moment_cap_nm", 1),
    ],
    "filter_hz": [("control/admittance", "FILTER_HZ", 1)],
    "ramp_m_s2": [("control/admittance", "_RAMP_M_S2", 1)],
    "moment_load_nm": [("control/admittance_law", "_MOMENT_LOAD_NM", 1)],
    "stall_percent": [("control/admittance", "STALL_SHARE", 100)],
}


class PageError(Exception):
    """The page needs something that is no longer in the source; says what and where."""


def _literal(file: str, name: str) -> float | None:
    """A constant, or a configuration field's default, as the source spells it; None where it is not."""
    path = HARDWARE / f"{file}.py"
    if not path.exists():
        return None
    owner, _, field = name.rpartition(".")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not owner and isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == field:
            return float(ast.literal_eval(node.value))
        if owner and isinstance(node, ast.ClassDef) and node.name == owner:
            for line in node.body:
                if isinstance(line, ast.AnnAssign) and ast.unparse(line.target) == field:
                    assert isinstance(line.value, ast.Call)
                    return next(
                        float(ast.literal_eval(word.value)) for word in line.value.keywords if word.arg == "default"
                    )
    return None


def numbers() -> dict[str, str]:
    """Every number of the page, as it is printed. Raises PageError where one is gone."""
    found = {}
    for name, places in NUMBERS.items():
        values = [value * factor for file, spelled, factor in places if (value := _literal(file, spelled)) is not None]
        if not values:
            raise PageError(f"docs/make_wire.py: {name}: none of {places} is in services/hardware; mend NUMBERS")
        found[name] = f"{values[0]:g}"
    return found


def lanes() -> list[tuple[str, ...]]:
    """(command's path, lane, what happens when the lane is busy) of every served command, read from the source."""
    served = {name: value.path for name, value in vars(keys).items() if isinstance(value, keys.Command)}
    trees = [
        ast.parse(text) for path in sorted(HARDWARE.parent.rglob("*.py")) if "serve(" in (text := path.read_text())
    ]
    spelled = {"NOW_LANE": NOW_LANE}
    for line in (line for tree in trees for line in tree.body):
        if isinstance(line, ast.Assign) and isinstance(line.value, ast.Constant):
            spelled[ast.unparse(line.targets[0])] = str(line.value.value)
    found = []
    for tree in trees:
        calls = [
            (node.func.attr, ast.unparse(node.args[0]), {word.arg: word.value for word in node.keywords})
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in SERVES
        ]
        # a shell's own `_serve` serves whatever it is given in the way of its one inner call
        inner = next((words for method, command, words in calls if method == "serve" and command not in served), {})
        for method, command, words in calls:
            if command in served:
                words = inner if method == "_serve" else words
                lane = ast.unparse(words["lane"]) if "lane" in words else "work"
                refused = "refuse_when_busy" in words and ast.literal_eval(words["refuse_when_busy"])
                path = served[command]
                what = "refused as `busy`" if refused else "waits its turn"
                found.append((f"`{path}`", LANES.get(path) or spelled.get(lane, lane), what))
    order = [f"`{command.path}`" for command in keys.commands()]
    return sorted(found, key=lambda row: order.index(row[0]))


def _up_to(least: int, most: int | None) -> str:
    if most is None:
        return "or more"
    return f"or {most}" if most == least + 1 else f"to {most}"


def kind_of(schema: dict[str, Any]) -> str:
    """A field's type in words."""
    if "$ref" in schema:
        return f"`{schema['$ref'].rsplit('/', 1)[-1]}`"
    if "anyOf" in schema:
        return " or ".join(kind_of(option) for option in schema["anyOf"])
    if schema.get("type") == "array":
        least, most = schema.get("minItems"), schema.get("maxItems")
        count = "" if least is None else f"{least} " if least == most else f"{least} {_up_to(least, most)} "
        return f"list of {count}{kind_of(schema['items'])}"
    if schema.get("type") == "object":
        return f"object of {kind_of(schema['additionalProperties'])}"
    return str(schema["type"])


def field_rows(schema: dict[str, Any]) -> list[tuple[str, ...]]:
    """(name, type with bounds, default, description); those that every message has are left out."""
    lines: list[tuple[str, ...]] = []
    for name, field in schema["properties"].items():
        if name in ("stamp_ns", "seq"):
            continue
        options = [field, *field.get("anyOf", ())]
        bounds = [f"{sign} {option[key]:g}" for option in options for key, sign in BOUNDS.items() if key in option]
        if name in schema.get("required", ()):
            value = "required"
        else:
            value = f"`{_json(field['default'])}`" if "default" in field else "empty"
        lines.append((f"`{name}`", ", ".join([kind_of(field), *bounds]), value, field.get("description", "")))
    return lines


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def described() -> list[dict[str, Any]]:
    """Every message and then every part of one: name, text, rows."""
    whole: list[dict[str, Any]] = []
    parts: dict[str, dict[str, Any]] = {}
    for kind in types():
        if issubclass(kind, Message):
            schema = kind.model_json_schema()
            whole.append({"name": label_of(kind), "text": schema.get("description", ""), "rows": field_rows(schema)})
            parts |= {name: part for name, part in schema.get("$defs", {}).items() if "properties" in part}
    for kind in types():
        parts.pop(kind.__name__, None)
    return whole + [
        {"name": name, "text": part.get("description", ""), "rows": field_rows(part)}
        for name, part in sorted(parts.items())
    ]


def enums() -> list[dict[str, Any]]:
    """Every enumeration of the messages: name, text, (value, meaning) with the meanings from the source's comments."""
    named = [getattr(messages, name) for name in sorted(messages.__all__)]
    return [
        {
            "name": kind.__name__,
            "text": inspect.getdoc(kind) or "",
            "rows": [(f"`{m['value']}`", m["meaning"] or "") for m in ENUM_VALUE.finditer(inspect.getsource(kind))],
        }
        for kind in named
        if isinstance(kind, type) and issubclass(kind, Enum)
    ]


def table(headings: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    """A Markdown table."""
    head = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    cells = [[cell.replace("\n", " ").replace("|", "\\|") for cell in line] for line in lines]
    return "\n".join([*head, *("| " + " | ".join(row) + " |" for row in cells)])


def page() -> str:
    """The page's text. Raises PageError where page and source have parted."""
    environment = Environment(
        loader=FileSystemLoader(HERE),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,
        keep_trailing_newline=True,
    )
    averaged_over = "`average_s`" if "average_s" in GuardedMove.model_fields else "`observe_samples` sensor samples"
    text = environment.get_template(TEMPLATE).render(
        **numbers(),
        table=table,
        root=keys.ROOT,
        endpoint=DEFAULT_ENDPOINT,
        lease_ms=LEASE_MS,
        alive_lease_ms=ALIVE_LEASE_MS,
        alive_beats=ALIVE_BEATS,
        heartbeat_ms=f"{HEARTBEAT_S * 1000:g}",
        ahead_s=f"{AHEAD_NS / 1e9:g}",
        cache=HISTORY[keys.Kind.STATE],
        now_lane=NOW_LANE,
        alive=keys.ALIVE_PATH,
        author=keys.AUTHOR_PATH,
        most_held=MAX_HELD,
        calibrating=[command for command in keys.commands() if command.changes_calibration],
        camera=keys.CAMERA_ALIVE,
        encodings=", ".join(f"`{name}`" for name in ENCODINGS),
        needed=NEEDED,
        keys=table(HEADINGS, [(f"`{row[0]}`", f"`{row[1]}`", *row[2:]) for row in rows()]),
        lanes=table(("command", "lane", "when the lane is at work"), lanes()),
        refusals=table(("code", "meaning"), [(f"`{code}`", meaning) for code, meaning in REFUSALS.items()]),
        proto=image_proto(),
        messages=described(),
        enums=enums(),
        creep_until=f"`observe_s` or {averaged_over}",
        averaged_over=averaged_over,
        planning=PlanningConfig(),
        vision=VisionConfig(),
    )
    return re.sub(r"\n{3,}", "\n\n", text)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE
    target.write_text(page(), encoding="utf-8")
    print(target)
