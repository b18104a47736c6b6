"""Tables and diagrams of the docs that are printed from the code, between two comments.

    <!-- printed: NAME -->
    ...
    <!-- /printed -->

`DOCS_WRITE=1 make test`, or pytest on the test that fails, writes them anew.
"""

import os
import re
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"


def assert_printed(page: str, name: str, lines: Iterable[str]) -> None:
    """A page has these lines as the block of that name; with DOCS_WRITE it gets them."""
    path, block = DOCS / page, "\n".join(lines)
    text = path.read_text(encoding="utf-8")
    begin, end = re.escape(f"<!-- printed: {name} -->\n"), re.escape("\n<!-- /printed -->")
    found = re.search(f"(?<={begin})(.*?)(?={end})", text, re.DOTALL)
    assert found, f"docs/{page} has no place for '{name}': see tests/printed.py"
    if os.environ.get("DOCS_WRITE"):
        path.write_text(text[: found.start()] + block + text[found.end() :], encoding="utf-8")
        return
    assert found[0] == block, f"print '{name}' in docs/{page} anew: DOCS_WRITE=1 with this test"


def state_table(states: Iterable[Enum], rows: Mapping[tuple[Enum, Enum], Enum]) -> list[str]:
    """The lines of a table of states: (state, event) -> next state, in a state's own order."""
    lines = ["", "| state | | event | next state |", "|---|---|---|---|"]
    for state in states:
        mine = [(event, after) for (of, event), after in rows.items() if of is state]
        name, what = state.name, state.value
        for event, after in mine:
            lines.append(f"| {name} | {what} | {event.value} | {after.name} |")
            name = what = ""
        if not mine:
            lines.append(f"| {name} | {what} | | |")
    return [*lines, ""]
