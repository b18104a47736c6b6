"""`make tolerances`: whether tests detect a changed tolerance of the rehearsal's judge.

Runs the tests of the judge once, and stores every flight that they judge. Then it multiplies and
divides each constant of the judge's modules by a factor, and judges the flights again by the rules
that use it. A constant that can be changed both ways without a different verdict is not covered by
a test. Prints a table; the exit code is 1 if such a constant is not listed, with a reason, in
`LOOSE`.
"""

import argparse
import ast
import importlib
import pkgutil
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, Final, NamedTuple

import pytest

from benchmarks.patched import ROOT
from sitl.rehearsal import judge as room
from sitl.rehearsal.judge import Case, Evidence, EvidenceError, Rule, rooms_of, verdict

TESTS: Final = "tests/sitl/rehearsal/judge"
FACTOR: Final = 3.0

LOOSE: Final = MappingProxyType(
    {
        "space._FAR_M": "no fence: any number that is far enough",
        "mission_reader._SIDE_M": "corners on long sides: any number that is short enough",
        "mission_reader._SIDE_DEG": "the same",
        "verdict._LAST_CHARACTERS": "letters of the report",
        "reactions._SECOND": "samples of a second: the interval of checks",
        "plan._FAR_M": "where no fence is: any number that is far enough",
        "space._CORNER_M": "how fine the edges of a way around a corner are",
        "map_reader._FOOT_M": "a unit: the tests of the reader hold it, without a flight",
        "map_reader._NAUTICAL_MILE_M": "the same",
        "map_reader._COLD": "how low a flight level may be: the same",
        "map_reader._LOW_M": "the same",
    }
)
"""Numbers of the judge that are no tolerances, and why."""


class Number(NamedTuple):
    """A number at the top of a module of the judge."""

    module: ModuleType
    name: str

    @property
    def qualified(self) -> str:
        """As in `LOOSE`: module and name."""
        return f"{self.module.__name__.rpartition('.')[2]}.{self.name}"


def modules() -> list[ModuleType]:
    """Those of the judge."""
    names = [info.name for info in pkgutil.iter_modules(room.__path__)]
    return [importlib.import_module(f"{room.__name__}.{name}") for name in names]


def numbers() -> Iterator[Number]:
    """The tolerances: numbers, and tuples of numbers, that a module gives a name."""
    for module in modules():
        tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
        for node in tree.body:
            targets = node.targets if isinstance(node, ast.Assign) else []
            targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
            for name in (n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)):
                value = getattr(module, name, None)
                whole = name.isupper() and name.rpartition("_")[2] in _UNITS
                if whole and isinstance(value, float | int | tuple) and moved(value, 2.0) != value:
                    yield Number(module, name)


_UNITS: Final = frozenset(
    {
        *("M", "S", "DEG", "S2", "SHARE", "NUMBER", "POINTS"),
        *("MARGIN", "SLACK", "LEFT", "EARLY", "CRUISES", "RESERVE", "SAGS", "JUMPS", "COLD"),
        *("DETOUR", "LAYERS", "ROUNDABOUT", "ESTIMATE", "TIMES", "OTHERS", "MM", "SECOND", "WORDS"),
    }
)
"""How names of tolerances end: in a unit, or in what they are a share of."""


def moved(value: Any, factor: float) -> Any:
    """A number, or the numbers of a tuple, times a factor; a count stays one."""
    if isinstance(value, tuple):
        return tuple(moved(each, factor) for each in value)
    if isinstance(value, int) and not isinstance(value, bool):
        return max(round(value * factor), 1)
    return value * factor if isinstance(value, float) else value


def behind(module: ModuleType) -> set[str]:
    """The modules of the judge that use one, directly or by others, and itself: names."""
    found = {module.__name__}
    while True:
        users = {each.__name__ for each in modules() if _uses(each) & found}
        if users <= found:
            return found
        found |= users


@cache
def _uses(module: ModuleType) -> set[str]:
    """The modules of which a module took something by name."""
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    return {str(node.module) for node in tree.body if isinstance(node, ast.ImportFrom)}


def test_files() -> list[str]:
    """The tests of the judge; first those that were written for its limits, and notice most."""
    paths = sorted(ROOT.joinpath(TESTS).glob("test_*.py"))
    return sorted(map(str, paths), key=lambda path: not re.search("limits|tolerances", path))


def flights() -> list[Evidence]:
    """All that the tests of the judge have judged."""
    kept: list[Evidence] = []
    judged = verdict.judge

    def keeping(evidence: Evidence) -> verdict.Verdict:
        kept.append(evidence)
        return judged(evidence)

    verdict.judge = keeping
    try:
        code = pytest.main(["-n", "0", "-q", "-p", "no:cacheprovider", *test_files()])
    finally:
        verdict.judge = judged
    if code:
        raise SystemExit("the tests of the judge fail with the code as it is")
    return kept


class Findings(NamedTuple):
    """What is found in a flight: which rules find what, and how it ended."""

    of_rules: frozenset[tuple[str, str]]
    end: str


class Flight(NamedTuple):
    """A flight that was judged, as the rules see it, and what they find; a text: why it is none."""

    evidence: Evidence
    case: Case | str
    findings: Findings


_REFUSED: Final = (EvidenceError, ArithmeticError, IndexError, ValueError)


def case_of(evidence: Evidence) -> Case | str:
    """A flight as the rules see it, or the error that states why it cannot be seen."""
    try:
        return Case(evidence)
    except _REFUSED as error:
        return type(error).__name__


def found(case: Case | str, rules: tuple[Rule, ...]) -> Findings:
    """What these rules find in a flight."""
    if isinstance(case, str):
        return Findings(frozenset(), case)
    rooms_of.cache_clear()
    try:
        kinds = ((rule.__name__, violation.kind) for rule in rules for violation in rule(case))
        return Findings(frozenset(kinds), verdict.end_of(case).value)
    except _REFUSED as error:
        return Findings(frozenset(), type(error).__name__)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tolerances", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="MODULE.NAME", help="check only these constants"
    )
    arguments = parser.parse_args()
    kept = []
    for evidence in flights():
        case = case_of(evidence)
        kept.append(Flight(evidence, case, found(case, verdict.RULES)))
    print(f"{len(kept)} flights", file=sys.stderr)
    print("| number | larger | smaller |\n|---|---|---|", flush=True)
    loose = []
    for number in numbers():
        if arguments.names and number.qualified not in arguments.names:
            continue
        cells = [bites(number, factor, kept) for factor in (FACTOR, 1.0 / FACTOR)]
        print(f"| {number.qualified} | {' | '.join(cells)} |", flush=True)
        if not any(cells) and number.qualified not in LOOSE:
            loose.append(number.qualified)
    for qualified in loose:
        print(f"{qualified} may be moved by a factor of {FACTOR:g} unnoticed", file=sys.stderr)
    return 1 if loose else 0


def bites(number: Number, factor: float, kept: list[Flight]) -> str:
    """The rule that finds something else in a flight with a moved number; empty: none."""
    value, concerned = getattr(number.module, number.name), behind(number.module)
    users = [m for m in modules() if vars(m).get(number.name) is value]
    rules = tuple(rule for rule in verdict.RULES if rule.__module__ in concerned)
    names = {rule.__name__ for rule in rules}
    for user in users:
        setattr(user, number.name, moved(value, factor))
    try:
        for evidence, case, known in kept:
            # Most numbers are of rules alone: what they look at is as it was.
            anew = case_of(evidence) if Case.__module__ in concerned else case
            now = found(anew, rules)
            other = now.of_rules ^ {each for each in known.of_rules if each[0] in names}
            if other:
                return min(other)[0]
            if now.end != known.end:
                return "the end of the flight"
    finally:
        for user in users:
            setattr(user, number.name, value)
    return ""


if __name__ == "__main__":
    sys.exit(main())
