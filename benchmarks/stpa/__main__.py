"""`make stpa`: breaks the code behind each cell of the table in docs/evidence/safety.md.

Every test that the table names must pass with the unchanged code, and must fail with each break of
`breaks.txt` that names it. A test that does not end counts as one that does not fail, because it
would not report the break. Prints a table; the exit code is 1 if a test does otherwise.
"""

import argparse
import json
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple

from benchmarks.patched import ROOT, Change, check
from benchmarks.sabotage.table import parse

LIMIT_S: Final = 600.0
"""Wall clock, of one test: it may run on a busy machine."""

_PAGE: Final = ROOT / "docs" / "evidence" / "safety.md"
_TEST: Final = re.compile(r"`(test_\w+)`")
_COLUMNS: Final = ("not given", "wrong", "too early, too late", "too short, too long")
_PASSED, _FAILED = 0, 1


class Break(NamedTuple):
    """A test of the table, and one way in which the code behind its cells is broken."""

    test: str
    changes: tuple[Change, ...]


BREAKS: Final = tuple(
    Break(entry.name, entry.changes)
    for entry in parse(Path(__file__).with_name("breaks.txt").read_text(encoding="utf-8"))
)


def cells(text: str | None = None) -> dict[str, list[str]]:
    """The cells that each test of the table stands in: `command: column`."""
    text = _PAGE.read_text(encoding="utf-8") if text is None else text
    section = text.partition("## Unsafe commands")[2].partition("\n## ")[0]
    found: dict[str, list[str]] = {}
    for line in [line for line in section.splitlines() if line.startswith("| ")][1:]:
        command, *row = (cell.strip() for cell in line.strip("|").split(" | "))
        for column, cell in zip(_COLUMNS, row, strict=True):
            for test in _TEST.findall(cell):
                found.setdefault(test, []).append(f"{command}: {column}")
    return found


def file_of(test: str) -> str:
    """Where a test stands, from the root."""
    named = re.compile(rf"^ *(?:async )?def {test}\b", re.MULTILINE)
    paths = sorted((ROOT / "tests").rglob("test_*.py"))
    found = [path for path in paths if named.search(path.read_text(encoding="utf-8"))]
    if not found:
        raise SystemExit(f"no test is called {test}")
    return str(found[0].relative_to(ROOT))


def outcome(test: str, changes: tuple[Change, ...] = ()) -> str:
    """What becomes of a test with changed code: "passes", "fails", or why it is inconclusive."""
    command = [sys.executable, "-m", "benchmarks.patched", json.dumps(list(changes))]
    command += ["pytest", "-n", "0", "-q", "-x", "-p", "no:cacheprovider"]
    command += [f"{file_of(test)}::{test}"]
    try:
        done = subprocess.run(  # noqa: S603 - our own program
            command, cwd=ROOT, capture_output=True, text=True, timeout=LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return "hangs"
    ran = re.search(r"\d+ (passed|failed|error)", done.stdout)
    if done.returncode == _PASSED and ran:
        return "passes"
    if done.returncode == _FAILED and "failed" in done.stdout:
        return "fails"
    return f"inconclusive: {(done.stdout + done.stderr).strip()[-300:]}"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stpa", description=__doc__)
    parser.add_argument("tests", nargs="*", metavar="TEST", help="run only these tests")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="number of parallel tests"
    )
    arguments = parser.parse_args()
    table = {t: c for t, c in cells().items() if not arguments.tests or t in arguments.tests}
    breaks = [each for each in BREAKS if each.test in table]
    for each in breaks:
        check(each.changes)
    wrong = [f"{test}: nothing breaks it" for test in table if test not in {b.test for b in breaks}]
    print("| unsafe command | test | broken in | with that it |\n|---|---|---|---|", flush=True)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        whole = dict(zip(table, pool.map(outcome, table), strict=True))
        wrong += [
            f"{test}: {how} with the code as it is"
            for test, how in whole.items()
            if how != "passes"
        ]
        broken = pool.map(lambda b: outcome(b.test, b.changes), breaks)
        for each, how in zip(breaks, broken, strict=True):
            where = each.changes[0].module
            print(f"| {'; '.join(table[each.test])} | {each.test} | {where} | {how} |", flush=True)
            wrong += [f"{each.test}: {how} with {where} broken"] if how != "fails" else []
    count = sum(map(len, table.values()))
    print(f"{count} cells, {len(breaks)} breaks, {len(wrong)} not as they should", file=sys.stderr)
    for text in wrong:
        print(text, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
