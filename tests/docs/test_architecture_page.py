"""docs/architecture.md names every room, and nothing that is not there."""

import re

from tests.docs.blocks import ROOT

PACKAGES = ("air_router", "geo", "mocha_link", "sitl")
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_every_room_is_named_under_its_package_and_no_other():
    for package in PACKAGES:
        section = PAGE.partition(f"\n## {package}\n")[2].partition("\n## ")[0]
        lines = re.findall(r"^\* ((?:`[\w/]+`(?:, )?)+):", section, re.MULTILINE)
        named = [room for line in lines for room in re.findall(r"`([\w/]+)`", line)]
        root = ROOT / package
        rooms = {file.parent.relative_to(root).as_posix() for file in root.rglob("*.py")} - {"."}
        assert sorted(named) == sorted(rooms), package


def test_every_path_exists():
    paths = re.findall(r"`([\w/]+(?:/|\.py))`", PAGE)
    assert len(paths) > 10
    for path in paths:
        assert path == "__init__.py" or (ROOT / path).exists(), path
    for path, name in re.findall(r"`([\w/]+\.py)` \(`(\w+)`\)", PAGE):
        assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), (path, name)
