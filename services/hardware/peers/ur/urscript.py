"""Runs URScript: a program as it was sent to a script port becomes Python generators, one a thread.

The language is that of Universal Robots' "The URScript Programming Language": `def`, `thread`, `if`, `while`, `global`,
`run`, `kill`, `join`, poses `p[...]`, keyword arguments. A name that is global anywhere, or set in the program's own
body, is one variable; any other that a function sets is its own. What takes time (`sync`, `servoj`, `stopj` ...) ends a
thread's turn in a control cycle. Functions that this controller does not have stop the program when they are called.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Generator, Iterator
from typing import Any

Steps = Generator[None, None, Any]

_OPENS = re.compile(r"^(def|thread|sec|if|elif|else|while|for)\b.*:$")
_GLOBAL = re.compile(r"^global\s+(\w+)\s*(=.*)$")
_RUN = re.compile(r"\brun\s+(\w+)\s*\(")
_MISSING = "this controller has no function"


class ScriptError(Exception):
    """The program cannot be read, or did something that stops it; the text says in which line of it."""


class Thread:
    """One thread of a program: what is left of it."""

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        self.alive = True

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)


class Program:
    """A program that runs a turn of every thread in each control cycle. Raises ScriptError where it cannot be read."""

    def __init__(self, text: str, functions: dict[str, Callable[..., Any]], blocking: dict[str, Callable[..., Steps]]):
        tree, self.name = _translated(text, set(blocking))
        self._names: dict[str, Any] = {
            "__builtins__": {"range": range, "len": len, "abs": abs, "floor": int},
            **functions,
            **blocking,
            "_run": self._run,
            "_kill": self._kill,
            "_join": self._join,
        }
        exec(compile(tree, f"<{self.name}>", "exec"), self._names)
        self.threads: list[Thread] = []
        self._main = self._run(self._names["_main"])

    @property
    def running(self) -> bool:
        """Whether its main thread has not ended: the others end with it."""
        return self._main.alive

    def step(self) -> None:
        """A turn of every thread, in the order in which they were started. Raises ScriptError: the program is over."""
        for thread in self.threads:  # one that is started now has its turn now
            if not thread.alive:
                continue
            try:
                next(thread.steps)
            except StopIteration:
                thread.alive = False
            except NameError as error:
                self._main.alive = False
                raise ScriptError(f"{self.name}: {_MISSING}: {error}") from None
            except (ArithmeticError, LookupError, TypeError, ValueError) as error:
                self._main.alive = False
                raise ScriptError(f"{self.name}: {type(error).__name__}: {error}") from None
        self.threads = [thread for thread in self.threads if thread.alive]

    def _run(self, function: Callable[..., Steps], *values: Any) -> Thread:
        thread = Thread(function(*values))
        self.threads.append(thread)
        return thread

    def _kill(self, thread: Any) -> None:
        if isinstance(thread, Thread):
            thread.alive = False
            thread.steps.close()

    def _join(self, thread: Any) -> Steps:
        while isinstance(thread, Thread) and thread.alive:
            yield


def whole_programs(text: str) -> tuple[list[str], str]:
    """The programs and single commands that stand whole in what came over a socket, and what is left of it."""
    found: list[str] = []
    depth, lines = 0, []
    rest = text
    while "\n" in rest:
        line, rest = rest.split("\n", 1)
        bare = _bare(line)
        lines.append(line)
        if _OPENS.match(bare) and not bare.startswith(("elif", "else")):
            depth += 1
        elif bare == "end":
            depth -= 1
        if depth <= 0:
            if any(_bare(each) for each in lines):
                found.append("\n".join(lines) + "\n")
            lines, depth = [], 0
    return found, "\n".join([*lines, rest]) if lines else rest


def _bare(line: str) -> str:
    """A line without comment and indentation."""
    quoted = False
    for index, sign in enumerate(line):
        if sign == '"':
            quoted = not quoted
        elif sign == "#" and not quoted:
            return line[:index].strip()
    return line.strip()


def _statements(text: str) -> Iterator[str]:
    """Lines without comments; what goes on in the next line is joined, a `global` within a line begins another."""
    begun = ""
    for line in text.splitlines():
        bare = _bare(line)
        if bare:
            begun = f"{begun} {bare}".strip()
        if not begun or begun.endswith("="):
            continue
        first, *others = re.split(r"(?<=\S)\s+(?=global\s)", begun)
        yield first
        begun = ""
        for other in others:
            begun = other
            if not begun.endswith("="):
                yield begun
                begun = ""


def _translated(text: str, blocking: set[str]) -> tuple[ast.Module, str]:
    """The program as a module of generators with its body as `_main`, and the program's name."""
    shared: set[str] = set()
    python: list[str] = []
    depth = 0
    for bare in _statements(text):
        if bare == "end":
            depth -= 1
            continue
        bare = re.sub(r"\basync\b", "async_", bare)
        if bare in ("enter_critical", "exit_critical"):
            bare = "pass"
        if found := _GLOBAL.match(bare):
            shared.add(found[1])
            bare = f"{found[1]} {found[2]}"
        bare = re.sub(r"^local\s+", "", bare)
        bare = re.sub(r"^(thread|sec)\s+", "def ", bare)
        bare = re.sub(r"^kill\s+(\w+)$", r"_kill(\1)", bare)
        bare = re.sub(r"^join\s+(\w+)$", r"_join(\1)", bare)
        bare = re.sub(r"_run\((\w+), \)", r"_run(\1)", _RUN.sub(r"_run(\1, ", bare))
        opens = bool(_OPENS.match(bare))
        at = depth - 1 if bare.startswith(("elif ", "elif(", "else:")) else depth
        python.append("    " * at + bare)
        if opens:
            depth = at + 1
            python.append("    " * depth + "pass")
    if depth:
        raise ScriptError(f"{depth} blocks of the program are not ended")
    if len(python) and not python[0].startswith("def "):
        python = ["def command():", *("    " + line for line in python)]
    try:
        program = ast.parse("\n".join(python)).body[0]
    except (SyntaxError, IndexError) as error:
        raise ScriptError(f"not a program: {error}") from None
    if not isinstance(program, ast.FunctionDef):
        raise ScriptError("not a program: want `def name():` ... `end`")
    inner = [node for node in program.body if isinstance(node, ast.FunctionDef)]
    name, main = program.name, program
    main.name, main.body = "_main", [node for node in program.body if node not in inner] or [ast.Pass()]
    shared |= _assigned(main)
    yields = blocking | {node.name for node in inner} | {"_join"}
    functions = [_generator(node, shared, yields) for node in [*inner, main]]
    tree = ast.Module([*functions], [])
    return ast.fix_missing_locations(tree), name


def _assigned(function: ast.FunctionDef) -> set[str]:
    return {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


def _generator(function: ast.FunctionDef, shared: set[str], yields: set[str]) -> ast.FunctionDef:
    own = {argument.arg for argument in function.args.args}
    names = sorted((_assigned(function) & shared) - own)
    function = _Waits(yields).visit(function)
    nothing = ast.Expr(ast.YieldFrom(ast.Tuple([], ast.Load())))
    function.body = [*([ast.Global(names)] if names else []), nothing, *function.body]
    return function


class _Waits(ast.NodeTransformer):
    """Calls that may take time become `yield from`, poses become lists."""

    def __init__(self, yields: set[str]) -> None:
        self._yields = yields

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in self._yields:
            return ast.YieldFrom(node)
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.value, ast.Name) and node.value.id == "p" and isinstance(node.slice, ast.Tuple):
            return ast.List(node.slice.elts, ast.Load())
        return node
