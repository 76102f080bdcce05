"""The key table says who sends, reads, serves and asks; here it is held to what the services' source really does."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import pytest

from crosspih_common import keys
from crosspih_common.errors import CrosspihError
from crosspih_common.holding.soundness import UNFIT
from crosspih_common.keys import ALL, CLOCK, WALL_CLOCK, Command, Topic
from crosspih_common.messages import Failure
from crosspih_common.refusals import REFUSALS
from crosspih_common.wrench import IMPLAUSIBLE
from tests.system.source import ROOT, files_below, parsed

READS, ASKS = ("latest", "reading", "subscribed", "subscribe", "subscribe_inline", "tap"), ("call", "ask")
BUS_METHODS = (*READS, *ASKS, "publisher", "serve")
# where a key comes as an argument: the recorder's tap on every topic, planning's port and the arm's own `_serve`, whose
# callers are counted, and what was asked in a recording or sent by a bench, on a bus of its own
MEASURING = "rate.py"  # a program that measures a service plays its caller itself, on a bus in memory
NOT_SPELLED = {
    "services/recorder/shell.py": "topic",
    "services/planning/shell.py": "command",
    "services/hardware/shells/arm.py": "command",
    "services/operator/assembly/display/live.py": "ESTIMATE.reply_echo",
    "services/operator/topic/listening.py": "topic",
    "services/operator/bench/speed/bus/ways.py": "TOPIC",
    "services/operator/bench/speed/where_time_goes.py": "echo",
    "services/operator/bench/reliability/kills/watching.py": "command.reply_echo",
    "services/operator/recordings/replay/answers.py": "asked.command",
    "services/ros2/shell.py": "command.reply_echo",
    "services/foxglove/shell.py": "topic",
    "services/viewer/live.py": "command.reply_echo",
}
HOLDING = "crosspih_common.holding"  # takes and keeps the lease for the services that import it
CLIENT = "crosspih_common.client"  # asks and hears for the services that import it
# in it: the commands of an assembly, whose answers it hears, and the topic of a stream, which may be any
CLIENTS_OWN = {"assembly_request.py": "command.reply_echo", "cell.py": "row"}
LIVE_STREAMS = "LiveStreams"  # of the same package: hears encoders and sensor for whoever has it look at a cell
TABLE: dict[str, Topic[Any] | Command[Any, Any]] = {
    name: value for name, value in vars(keys).items() if isinstance(value, (Topic, Command))
}
# commands that nobody serves or nobody asks yet: to be taken out of here by whoever builds the other end
AWAITED: set[str] = set()
BUILT = [name for name in TABLE if name not in AWAITED]
Uses = dict[str, dict[str, set[str]]]  # bus method: constant: services


def key_names(tree: ast.Module) -> dict[str, str]:
    """What a file calls the constants of the table, and their own names."""
    return {
        alias.asname or alias.name: alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "crosspih_common.keys"
        for alias in node.names
        if alias.name in TABLE
    }


def imported_names(tree: ast.Module) -> set[str]:
    """What a file imports by name."""
    return {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}


def bus_calls(tree: ast.Module, names: dict[str, str]) -> Iterator[tuple[str, ast.expr, int]]:
    """(method, first argument, line) of every call with a key, and of every one on the bus or on planning's ports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            method, on, argument = node.func.attr.strip("_"), node.func.value, node.args[0]
            holder = on.attr if isinstance(on, ast.Attribute) else on.id if isinstance(on, ast.Name) else ""
            keyed = isinstance(argument, ast.Name) and argument.id in names
            if method in BUS_METHODS and (keyed or holder.strip("_") in ("bus", "ports")):
                yield method, argument, node.lineno


@pytest.fixture(scope="module")
def uses() -> Uses:
    """Who uses which constant how. Fails where a call on the bus spells no constant: the table could not be held."""
    found: Uses = defaultdict(lambda: defaultdict(set))
    holders: set[str] = set()
    clients: set[str] = set()
    for path in files_below(ROOT / "services"):
        if path.name == MEASURING:
            continue
        tree = parsed(path)
        names, where = key_names(tree), path.relative_to(ROOT).as_posix()
        if any(isinstance(node, ast.ImportFrom) and (node.module or "").startswith(HOLDING) for node in ast.walk(tree)):
            holders.add(where.split("/")[1])
        if any(isinstance(node, ast.ImportFrom) and (node.module or "").startswith(CLIENT) for node in ast.walk(tree)):
            clients.add(where.split("/")[1])
        if LIVE_STREAMS in imported_names(tree):
            for name in ("JOINT_STATE", "WRENCH_RAW"):
                found["latest"][name].add(where.split("/")[1])
        for method, argument, line in bus_calls(tree, names):
            if isinstance(argument, ast.Name) and argument.id in names:
                found[method][names[argument.id]].add(where.split("/")[1])
            else:
                assert ast.unparse(argument) == NOT_SPELLED.get(where), (where, line, ast.unparse(argument))
    for path in sorted(ROOT.joinpath(*HOLDING.split(".")).glob("*.py")):
        tree = parsed(path)
        names = key_names(tree)
        for method, argument, _ in bus_calls(tree, names):
            if isinstance(argument, ast.Name) and argument.id in names:
                found[method][names[argument.id]] |= holders
    for path in sorted(ROOT.joinpath(*CLIENT.split(".")).glob("*.py")):
        tree = parsed(path)
        names = key_names(tree)
        for method, argument, line in bus_calls(tree, names):
            if isinstance(argument, ast.Name) and argument.id in names:
                found[method][names[argument.id]] |= clients
            else:
                assert ast.unparse(argument) == CLIENTS_OWN.get(path.name), (path, line, ast.unparse(argument))
    return found


def users(uses: Uses, methods: tuple[str, ...], name: str) -> set[str]:
    return set().union(*(uses[method].get(name, set()) for method in methods))


def test_what_is_awaited_is_not_built(uses: Uses) -> None:
    for name in AWAITED:
        both = users(uses, ASKS, name) and users(uses, ("serve",), name)
        assert not both, f"{name} is built: take it out of AWAITED"


@pytest.mark.parametrize("name", [name for name in BUILT if isinstance(TABLE[name], Topic)])
def test_a_topic_has_the_readers_and_the_sender_that_the_source_has(uses: Uses, name: str) -> None:
    topic = TABLE[name]
    assert isinstance(topic, Topic)
    reading = users(uses, READS, name) | {"recorder", "operator"}  # the one takes them all, the other may stream any
    if topic is CLOCK:
        reading |= set(ALL) - {topic.publisher}  # Bus listens to it for every service but the clock's own
    assert set(topic.readers) == reading, name
    if topic.publisher != "{service}":
        assert users(uses, ("publisher",), name) == {topic.publisher}, name


@pytest.mark.parametrize("name", [name for name in BUILT if isinstance(TABLE[name], Command)])
def test_a_command_has_the_callers_and_the_server_that_the_source_has(uses: Uses, name: str) -> None:
    command = TABLE[name]
    assert isinstance(command, Command)
    asking = users(uses, ASKS, name)
    if command is WALL_CLOCK:
        asking |= set(ALL) - {command.server}  # every service's life measures its machine's clock against the cell's
    assert set(command.callers) == asking, name
    assert users(uses, ("serve",), name) == {command.server}, name


# ------------------------------------------------------------------------------------------------------------- refusals


def spelled_codes() -> dict[str, set[str]]:
    """Every code with which the source refuses, and the files that do; what is not a literal as its source text."""
    codes: dict[str, set[str]] = defaultdict(set)
    for top in ("services", "crosspih_common"):
        for path in files_below(ROOT / top):
            where = path.relative_to(ROOT).as_posix()
            if where.startswith("services/operator/"):
                continue  # it serves nothing: what it raises so stays in its own process
            for node in ast.walk(parsed(path)):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "CommandRefused":
                    code = node.args[0]
                    codes[str(code.value) if isinstance(code, ast.Constant) else ast.unparse(code)].add(where)
                if where == "crosspih_common/errors.py" and isinstance(node, ast.Call) and node.args:
                    code = node.args[0]  # a kind of refusal with a code of its own: super().__init__(code, text)
                    if ast.unparse(node.func) == "super().__init__" and isinstance(code, ast.Constant):
                        codes[str(code.value)].add(where)
                if where == "services/vision/refusals.py" and isinstance(node, ast.Assign):
                    codes[ast.literal_eval(node.value)].add(where)
    return codes


def codes_of(error: type[CrosspihError]) -> set[str]:
    return {error.code}.union(*(codes_of(kind) for kind in error.__subclasses__()))


# codes that are worked out: what they can be. The bus answers a ContractError, a BusClosed and a refusal as itself.
WORKED_OUT = {
    "refusal.refused": set(),  # planning's own, told again by the client whose answer was lost
    "step.refusal.refused": set(),  # a service's own, told again from a recording
    "f'{name}_limit'": {"speed_limit", "acceleration_limit"},
    "refusals[0].code": set(),  # services/vision/refusals.py spells them
    "code or 'unknown'": set(),  # a reader's, for an error reply that is none of ours
    "answer['refused']": set(),  # the arm's own, told on by the process that beats
    "error.failure.value": {failure.value for failure in Failure},
    "Failure.SERVICE_LOST.value": {Failure.SERVICE_LOST.value},
    "IMPLAUSIBLE": {IMPLAUSIBLE},
    "UNFIT": {UNFIT},
    "error.code": {"no_service", "command_timeout", "bus_unreachable", "config", "bad_answer", "internal"},
}


def test_every_refusal_is_in_the_table_and_none_else() -> None:
    spelled = spelled_codes()
    unknown = [code for code in spelled if not code.isidentifier() and code not in WORKED_OUT]
    assert not unknown, f"worked out, and the test does not know to what: {unknown}"
    codes = {code for code in spelled if code not in WORKED_OUT}
    codes |= set().union(*(WORKED_OUT[code] for code in spelled if code in WORKED_OUT))
    assert codes - REFUSALS.keys() == set(), "say in crosspih_common/refusals.py what they mean"
    assert REFUSALS.keys() - codes == set(), "nobody refuses so; take it out of crosspih_common/refusals.py"


def test_every_code_is_spelled_alike_and_every_error_that_the_bus_tells_on_has_one() -> None:
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", code) for code in REFUSALS)
    assert codes_of(CrosspihError) == WORKED_OUT["error.code"]
