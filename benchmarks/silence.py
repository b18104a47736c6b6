"""Where a motion is requested from the controller, and it returns none and reports nothing.

A motion is requested from

* `begin`, `arrived`, `no_route`, `retry` and `replan` of the heirs of `StateHandler`;
* the methods in `REQUESTED`, which take a motion towards the vehicle.

A return of theirs is silent if on some way through the function to it, by its statements alone,

* no other function of these is called (that one is judged where it stands);
* nothing leaves (`LEAVES`), and nothing of `REPORTS` is called, nor a function of the controller
  that does so on all of its ways;
* and no value but None is returned: a motion, a verdict with a name, or `Rest`, which states why
  nothing is wanted.

The end of a function is a return. What a condition is true for is not known: a loop may run not at
all, and each branch may be taken. So a motion that is under way already, for which nothing is to be
done, counts until a name states that as well.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Final, NamedTuple

HANDLER: Final = "StateHandler"
HANDLES: Final = ("begin", "arrived", "no_route", "retry", "replan")
"""The methods of a state's handler from which a motion is requested."""

REQUESTED: Final[Mapping[str, tuple[str, ...]]] = {
    "CommandGate": ("command", "send", "hold", "_block", "wait_here", "wait_for_way"),
    "InitialClimb": ("first",),
    "Navigator": ("fly_to",),
}
"""The other methods from which a motion is requested, by class."""

REPORTS: Final[Mapping[str, str]] = {
    "say": "an announcement",
    "warn": "an announcement",
    "alarm": "an announcement",
    "alarm_until_over": "an announcement",
    "signal": "a change of state, which is recorded, and whose handler is queried",
    "come_home": "the same",
    "advance": "the next motion is commanded, or the state is queried for what it wants",
    "_waits_for": "a verdict: the row of `INTERLOCKS` that keeps the motion back",
}
"""Calls that report what becomes of it."""

_REPORTING: Final = {*REPORTS, *HANDLES, *chain.from_iterable(REQUESTED.values())}

LEAVES: Final = ".actions.append"
"""How a motion leaves the controller."""


class Silence(NamedTuple):
    """A silent return.

    Attributes:
        file: Path from the root.
        line: Of the return; the last one of a function that ends without.
        function: Class and method.
    """

    file: str
    line: int
    function: str


class _Method(NamedTuple):
    file: str
    holder: ast.ClassDef
    code: ast.FunctionDef


def silences(trees: Mapping[str, ast.Module]) -> list[Silence]:
    """The silent returns of the controller.

    Args:
        trees: Its files, parsed, by their paths from the root.
    """
    methods = [*_methods(trees)]
    requested = [each for each in methods if _is_requested(each)]
    reader = _Reader(methods)
    return [
        Silence(each.file, line, f"{each.holder.name}.{each.code.name}")
        for each in requested
        for line in reader.silent_lines(each.code)
    ]


def _methods(trees: Mapping[str, ast.Module]) -> Iterator[_Method]:
    for path, tree in trees.items():
        for holder in ast.walk(tree):
            if isinstance(holder, ast.ClassDef):
                for code in holder.body:
                    if isinstance(code, ast.FunctionDef):
                        yield _Method(path, holder, code)


def _is_requested(method: _Method) -> bool:
    if method.code.name in REQUESTED.get(method.holder.name, ()):
        return True
    heir = HANDLER in map(ast.unparse, method.holder.bases)
    return heir and method.code.name in HANDLES


class _Reader:
    """Reads the ways through functions.

    Args:
        methods: All of the controller.
    """

    def __init__(self, methods: Iterable[_Method]) -> None:
        self._others: dict[str, list[ast.FunctionDef]] = {}
        for each in methods:
            self._others.setdefault(each.code.name, []).append(each.code)
        self._always: dict[str, bool] = {}  # by name: whether it does on all of its ways
        self._found: list[int] = []
        self._values_count = True  # a value that is returned is an answer

    def silent_lines(self, code: ast.FunctionDef) -> list[int]:
        """The lines of a function's silent returns."""
        return self._read(code, values_count=True)

    def _read(self, code: ast.FunctionDef, *, values_count: bool) -> list[int]:
        outer = self._found, self._values_count
        self._found, self._values_count = [], values_count
        if self._through(code.body, reported=False) is False:
            self._found.append(code.end_lineno or code.lineno)
        found, (self._found, self._values_count) = self._found, outer
        return found

    def _through(self, body: Sequence[ast.stmt], *, reported: bool) -> bool | None:
        """Whether it is reported by the end of these statements; None: their end is not reached."""
        for statement in body:
            if isinstance(statement, ast.Return):
                self._note(statement, reported=reported)
            ends = [end for end in self._ends(statement, reported=reported) if end is not None]
            if not ends:
                return None
            reported = all(ends)
        return reported

    def _note(self, end: ast.Return, *, reported: bool) -> None:
        """Take a return in, if it is silent."""
        answers = self._values_count and end.value is not None and ast.unparse(end.value) != "None"
        if not (reported or answers or self._reports(end.value)):
            self._found.append(end.lineno)

    def _ends(self, statement: ast.stmt, *, reported: bool) -> list[bool | None]:
        """What `_through` returns of each way through one statement."""
        match statement:
            case ast.Return() | ast.Raise() | ast.Break() | ast.Continue():
                return []
            case ast.If(test=test, body=then, orelse=other):
                reported = reported or self._reports(test)
                return [self._through(part, reported=reported) for part in (then, other)]
            case ast.For(iter=head, body=inner) | ast.While(test=head, body=inner):
                reported = reported or self._reports(head)
                self._through(inner, reported=reported)
                return [reported]
            case ast.Match(subject=subject, cases=cases):
                reported = reported or self._reports(subject)
                ends = [self._through(case.body, reported=reported) for case in cases]
                whole = any(ast.unparse(case.pattern) == "_" for case in cases)
                return ends if whole else [*ends, reported]
            case ast.With(body=inner) | ast.Try(body=inner):
                caught = statement.handlers if isinstance(statement, ast.Try) else []
                bodies = [inner, *(each.body for each in caught)]
                return [self._through(each, reported=reported) for each in bodies]
        return [reported or self._reports(statement)]

    def _reports(self, node: ast.AST | None) -> bool:
        """Whether something is called in it that reports on all of its ways."""
        calls = [each for each in ast.walk(node) if isinstance(each, ast.Call)] if node else []
        return any(self._call_reports(ast.unparse(call.func)) for call in calls)

    def _call_reports(self, called: str) -> bool:
        name = called.rpartition(".")[2]
        if name in _REPORTING or called.endswith(LEAVES):
            return True
        if name not in self._always:
            self._always[name] = False  # while it is read: one that calls itself does not
            codes = self._others.get(name, [])
            silent = [self._read(code, values_count=False) for code in codes]
            self._always[name] = bool(codes) and not any(silent)
        return self._always[name]
