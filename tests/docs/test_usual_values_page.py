"""docs/evidence/usual-values.md is the code's table; DOCS_WRITE=1 writes it anew."""

import os

from tests.docs.usual_values_page import PAGE, page


def test_the_page_is_current():
    text = page()
    if os.environ.get("DOCS_WRITE"):
        PAGE.write_text(text, encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == text, (
        "usual values have changed: write the page anew with DOCS_WRITE=1 pytest tests/docs"
    )
