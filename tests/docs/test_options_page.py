"""docs/options.md says what the programs take; DOCS_WRITE=1 in the environment writes it anew."""

import os

from tests.docs.options_page import PAGE, page


def test_the_page_is_current():
    text = page()
    if os.environ.get("DOCS_WRITE"):
        PAGE.write_text(text, encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == text, (
        "options have changed: write the page anew with DOCS_WRITE=1 pytest tests/docs"
    )
