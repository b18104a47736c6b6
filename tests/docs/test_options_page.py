"""docs/commands.md names what the programs take, and the site explains it."""

import re
from types import SimpleNamespace

from tests.docs.options_page import PAGE, names, on_page_markdown
from tests.printed import assert_printed


def test_the_page_is_current():
    assert_printed("commands.md", "options", [*names().splitlines(), ""])


def test_the_site_explains_every_option_that_the_page_names():
    def in_the_site(name, text):
        page = SimpleNamespace(file=SimpleNamespace(src_uri=name))
        return on_page_markdown(text, page=page)

    text = PAGE.read_text(encoding="utf-8")
    commands = text.partition("<!-- printed: options -->")[2]
    whole = in_the_site("commands.md", text).partition("<!-- printed: options -->")[2]
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
    assert in_the_site("index.md", "as it is") == "as it is"
