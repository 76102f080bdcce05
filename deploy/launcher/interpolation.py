"""Variables in a compose file: ``$NAME``, ``${NAME}`` and the operators of the Compose specification.

    ${NAME:-default}  default if NAME is unset or empty      ${NAME-default}  default if NAME is unset
    ${NAME:?message}  refused if NAME is unset or empty      ${NAME?message}  refused if NAME is unset
    ${NAME:+other}    other if NAME is set and not empty     ${NAME+other}    other if NAME is set
    $$                a dollar sign

A variable that is unset and has no operator is refused (Compose warns and takes the empty string): an empty endpoint
or path would fail later and farther away. Defaults may hold variables themselves.
"""

import re
from collections.abc import Mapping
from typing import Any

from deploy.launcher.errors import Fault

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_OPERATORS = (":-", ":?", ":+", "-", "?", "+")


class _RefusedVariable(Exception):
    def __init__(self, problem: str, mend: str) -> None:
        super().__init__(problem)
        self.problem = problem
        self.mend = mend


def interpolate(tree: Any, variables: Mapping[str, str], field: str = "") -> tuple[Any, list[Fault]]:
    """Return ``tree`` (what YAML gave) with every string value interpolated, and the faults found, by dotted field.

    Mapping keys are left as they are, as in Compose.
    """
    faults: list[Fault] = []
    return _walk(tree, variables, field, faults), faults


def _walk(node: Any, variables: Mapping[str, str], field: str, faults: list[Fault]) -> Any:
    if isinstance(node, str):
        try:
            return _substitute(node, variables)
        except _RefusedVariable as refused:
            faults.append(Fault(field, refused.problem, refused.mend))
            return node
    if isinstance(node, dict):
        return {key: _walk(value, variables, _join(field, key), faults) for key, value in node.items()}
    if isinstance(node, list):
        return [_walk(value, variables, _join(field, index), faults) for index, value in enumerate(node)]
    return node


def _join(field: str, key: object) -> str:
    return f"{field}.{key}" if field else str(key)


def _substitute(text: str, variables: Mapping[str, str]) -> str:
    done: list[str] = []
    position = 0
    while True:
        dollar = text.find("$", position)
        if dollar < 0:
            return "".join([*done, text[position:]])
        done.append(text[position:dollar])
        following = text[dollar + 1 : dollar + 2]
        if following == "$":
            done.append("$")
            position = dollar + 2
        elif following == "{":
            end = _closing_brace(text, dollar + 2)
            done.append(_braced(text[dollar + 2 : end], variables))
            position = end + 1
        elif name := _NAME.match(text, dollar + 1):
            done.append(_plain(name.group(), variables))
            position = name.end()
        else:
            raise _RefusedVariable(f"a lone '$' in {text!r}", "write '$$' for a dollar sign")


def _closing_brace(text: str, start: int) -> int:
    depth = 1
    position = start
    while position < len(text):
        if text.startswith("${", position):
            depth += 1
            position += 1
        elif text[position] == "}":
            depth -= 1
            if depth == 0:
                return position
        position += 1
    raise _RefusedVariable(f"'${{' without '}}' in {text!r}", "close it, or write '$$' for a dollar sign")


def _plain(name: str, variables: Mapping[str, str]) -> str:
    if name not in variables:
        raise _RefusedVariable(
            f"the variable {name} is not set", f"set {name} in the environment or write ${{{name}:-default}}"
        )
    return variables[name]


def _braced(expression: str, variables: Mapping[str, str]) -> str:
    matched = _NAME.match(expression)
    if matched is None:
        raise _RefusedVariable(f"no variable name in '${{{expression}}}'", "write ${NAME} or ${NAME:-default}")
    name, rest = matched.group(), expression[matched.end() :]
    if not rest:
        return _plain(name, variables)
    operator = next((candidate for candidate in _OPERATORS if rest.startswith(candidate)), None)
    if operator is None:
        raise _RefusedVariable(
            f"unknown operator in '${{{expression}}}'", f"use one of {', '.join(_OPERATORS)} after {name}"
        )
    operand = rest[len(operator) :]
    value = variables.get(name)
    present = bool(value) if operator.startswith(":") else value is not None
    if operator.endswith("+"):
        return _substitute(operand, variables) if present else ""
    if present and value is not None:
        return value
    if operator.endswith("?"):
        raise _RefusedVariable(
            f"the variable {name} is required: {operand or 'not set'}", f"set {name} in the environment"
        )
    return _substitute(operand, variables)
