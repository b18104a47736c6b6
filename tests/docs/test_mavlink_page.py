"""docs/mavlink.md names what the code reads and sends, and nothing else is read."""

import re
from pathlib import Path

from air_router.mission.flight_plan import Command
from air_router.preflight.preflight_parameters import WANTED

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "mavlink.md").read_text(encoding="utf-8")
SOURCES = {path.name: path.read_text() for path in (ROOT / "air_router/vehicle").rglob("px4*.py")}


def section(title):
    return PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]


def test_what_is_read():
    received = set(re.findall(r'"([A-Z0-9_]+)": self\.[a-z_]', "\n".join(SOURCES.values())))
    assert received == set(re.findall(r"^\| ([A-Z0-9_]+) \|", section("Read"), re.MULTILINE))


def test_what_is_sent():
    code = "\n".join(SOURCES.values())
    sent = set(re.findall(r'(?:message\(|\.send\(|return )"([A-Z_]+)"', code))
    assert len(sent) >= 6
    for name in sent - {"COMMAND_LONG", "COMMAND_INT"}:
        assert name in section("Sent"), name
    for value in (176, 178, 192, 400, 401, 511, 512, 21):
        assert f"({value})" in section("Sent")
    assert "plugins.action" not in code  # MAVSDK repeats what its plugins send: not even arming
    assert "start_mission" not in code


def test_items_and_parameters():
    assert set(re.findall(r"\((\d+)\)", section("Items of a plan"))) == {
        str(int(command)) for command in Command
    }
    named = set(re.findall(r"\b[A-Z]+_[A-Z_]+\b", section("Parameters read")))
    assert named == {each.name for each in WANTED}
