"""docs/evidence/conformance.md has every difference among versions of PX4 that `sitl conform` saw.

DOCS_WRITE=1 in the environment writes the tables anew.
"""

import os
from pathlib import Path

import pytest

from sitl.conformance.differences import differences, table_of_facts, table_of_steps

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "conformance.md"
TABLES = {"What a flight rests on": table_of_facts, "Steps that differ": table_of_steps}


@pytest.mark.parametrize("title", TABLES)
def test_the_tables_are_current(title):
    text = PAGE.read_text(encoding="utf-8")
    begin = text.index(f"### {title}\n")
    first = text.index("\n| ", begin) + 1
    end = text.index("\n\n", first)
    table = TABLES[title]()
    if os.environ.get("DOCS_WRITE"):
        PAGE.write_text(text[:first] + table + text[end:], encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8")[first:].startswith(f"{table}\n\n"), (
        "what differs has changed: write the tables anew with DOCS_WRITE=1 pytest tests/docs"
    )


def test_every_difference_has_where_it_is_written():
    found = list(differences())
    assert len(found) > 15
    for each in found:
        assert each.because, each
        assert each.versions, each
        assert each.usual != each.other
