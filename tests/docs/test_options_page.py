"""docs/options.md names what the programs take; DOCS_WRITE=1 in the environment writes it anew."""

import os
import re
from types import SimpleNamespace

from tests.docs.options_page import PAGE, on_page_markdown, page


def test_the_page_is_current():
    text = page()
    if os.environ.get("DOCS_WRITE"):
        PAGE.write_text(text, encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == text, (
        "options have changed: write the page anew with DOCS_WRITE=1 pytest tests/docs"
    )


def test_the_site_explains_every_option_that_the_page_names():
    def in_the_site(name):
        return on_page_markdown(
            "as it is", page=SimpleNamespace(file=SimpleNamespace(src_uri=name))
        )

    commands, whole = page().partition("\n## ")[2], in_the_site("options.md")
    heads = re.compile(r"^###.*$", re.MULTILINE)
    assert heads.findall(commands) == heads.findall(whole)
    explained = set(re.findall(r"^\* (`.*?`)(?: \(needed\))?: \S", whole, re.MULTILINE))
    named = {
        name
        for line in commands.splitlines()
        if line.startswith("`")
        for name in re.findall("`.*?`", line)
    }
    assert len(named) > 100
    assert named == explained
    assert in_the_site("index.md") == "as it is"
