"""docs/architecture.md names every room, and nothing that is not there."""

import ast
import re

import pytest

from tests.docs.blocks import ROOT
from tests.printed import assert_printed

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("package", ["air_router", "geo", "mocha_link", "sitl"])
def test_every_room_is_listed_with_the_first_line_of_its_door(package):
    lines = []
    for door in sorted((ROOT / package).glob("*/**/__init__.py")):
        purpose = ast.get_docstring(ast.parse(door.read_text(encoding="utf-8")))
        room = door.parent.relative_to(ROOT / package).as_posix()
        lines.append(f"* `{room}`: {purpose.splitlines()[0]}")
    assert_printed("architecture.md", package, ["", *lines, ""])


def test_every_path_exists():
    paths = re.findall(r"`([\w/]+(?:/|\.py))`", PAGE)
    assert len(paths) > 10
    for path in paths:
        assert path == "__init__.py" or (ROOT / path).exists(), path
    for path, name in re.findall(r"`([\w/]+\.py)` \(`(\w+)`\)", PAGE):
        assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), (path, name)
