"""Tables and diagrams of the docs that are printed from the code, between two comments.

    <!-- printed: NAME -->
    ...
    <!-- /printed -->

`DOCS_WRITE=1 make test`, or pytest on the test that fails, writes them anew.
"""

import os
import re
from collections.abc import Iterable
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
