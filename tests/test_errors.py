"""docs/errors.md lists every code that a problem of a file can have, and no other."""

import re
import textwrap
from pathlib import Path

from tests.printed import assert_printed

ROOT = Path(__file__).parents[1]
KEBAB = re.compile(r"[a-z0-9]+(-[a-z0-9]+)+")
SINGLE_WORDS = {"unreadable"}
QUOTED = re.compile(rf'"({KEBAB.pattern}|{"|".join(SINGLE_WORDS)})"')

SOURCES = [
    *sorted((ROOT / "air_router").rglob("*.py")),
    *sorted((ROOT / "mocha_link" / "team").glob("*.py")),
    ROOT / "geo" / "airspace" / "zone.py",
    ROOT / "sitl" / "world" / "world_file.py",
    ROOT / "sitl" / "experiment" / "plan_file.py",
    ROOT / "sitl" / "world" / "towns" / "town_file.py",
]
OTHER_THINGS = {
    "camera.py",
    "charts.py",
    "figure_style.py",
    "words.py",
    "guard.py",
    "tile_service.py",
    "versions.py",
}
"""Modules whose words with a hyphen name cameras, directions, headers, styles, conversations."""

NO_CODES = {
    *("air-router", "utf-8", "utf-8-sig", "fill-opacity", "pre-flight"),
    *("base-port", "node-type", "using-radio"),  # keys of original nodes
    "go-tos",
    "signing-key",  # a command
    *("no-store", "color-scheme", "v-5", "15-19"),  # of HTTP and HTML, of a picture, of a range
}


def codes_in_the_sources():
    found = set()
    for path in SOURCES:
        if path.name not in OTHER_THINGS:
            found |= {each[1] for each in QUOTED.finditer(path.read_text(encoding="utf-8"))}
    return found - NO_CODES


def test_the_list_has_every_code():
    codes = " · ".join(f"`{code}`" for code in sorted(codes_in_the_sources()))
    lines = textwrap.wrap(codes, 128, break_on_hyphens=False)
    assert_printed("errors.md", "codes", ["", *lines, ""])


def test_no_code_is_made_up():
    page = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
    text = page.partition("\n## Problems in files\n")[2]
    documented = {w for w in re.findall(r"`([^`]+)`", text) if KEBAB.fullmatch(w)} | SINGLE_WORDS
    assert documented == codes_in_the_sources()
