"""The evidence that safety.md names exists, in every cell; so do the tests for old faults."""

import csv
import re
from pathlib import Path

from benchmarks.sabotage.table import SABOTAGES
from sitl.rehearsal.faults import Fault

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "evidence" / "safety.md").read_text("utf-8")
SHOWN = (ROOT / "docs" / "evidence" / "faults-of-c597b59.csv").read_text("utf-8")
SECOND = (ROOT / "docs" / "evidence" / "faults-of-7f645deb.csv").read_text("utf-8")
SURVIVORS = (ROOT / "docs" / "evidence" / "sabotages-that-survive.csv").read_text("utf-8")
NAME = re.compile(r"^ *(?:async )?def (test_\w+)", re.MULTILINE)


def rows():
    section = TEXT.partition("## Unsafe commands")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[1:]]


def names_of_tests():
    for path in (ROOT / "tests").rglob("test_*.py"):
        yield from NAME.findall(path.read_text(encoding="utf-8"))


def test_every_unsafe_command_has_a_test_and_a_scene():
    known, table = set(names_of_tests()), rows()
    assert len(table) == 8
    for command, *cells in table:
        assert len(cells) == 4, command
        for cell in cells:
            named = re.findall(r"`(\w+)`", cell)
            assert [name for name in named if name.startswith("test_")], (command, cell)
            assert [name for name in named if name in Fault.__members__], (command, cell)
            for name in named:
                assert name in known or name in Fault.__members__, (command, name)


def test_every_belief_has_a_test_and_the_scenes_exist():
    section = TEXT.partition("## Inputs and their greatest age")[2].partition("\nMessages sent")[0]
    table = [line.split(" | ") for line in section.splitlines() if line.startswith("| ")][1:]
    known = set(names_of_tests()) | set(Fault.__members__)
    assert len(table) == 11
    for belief, *_, evidence in table:
        named = re.findall(r"`(\w+)`", evidence)
        assert [name for name in named if name.startswith("test_")], belief
        assert set(named) <= known, (belief, set(named) - known)


def test_what_shows_the_faults_of_an_older_version_exists():
    named = set(re.findall(r"test_\w+_\w+_\w+", SHOWN))
    assert len(named) > 40
    assert named <= set(names_of_tests())


def test_every_fault_of_the_second_version_has_a_test_that_failed_there():
    known = {*names_of_tests(), *Fault.__members__, "test_standstill"}
    found = list(csv.DictReader(SECOND.splitlines()))
    assert {row["section"] for row in found} == set("12345678")
    for row in found:
        named = set(re.findall(r"\b(?:test_\w+|[A-Z]{2,}_?[A-Z]+)\b", row["test"]))
        assert named, row["bullet"]
        assert named <= known, (row["bullet"], named - known)
        assert row["how it failed there"], row["bullet"]


def test_each_survivor_of_the_list_is_there_with_the_wall_behind_it_and_its_test():
    """In the list it is as it was, or with both walls broken."""
    known, names = set(names_of_tests()), [sabotage.name for sabotage in SABOTAGES]
    rows = [
        row for row in csv.reader(SURVIVORS.splitlines()) if row[0] == "the list of make sabotage"
    ]
    assert len(rows) == 6
    assert "cover [these six]" in TEXT.replace("\n", " ")
    for _, name, because in rows:
        assert [each for each in names if each.startswith(name)], name
        tests = re.findall(r"test_\w+", because)
        assert tests, name
        assert set(tests) <= known, name
