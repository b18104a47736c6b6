"""The commands and the snippet of docs/coverage.md and docs/coming-home.md work as they stand."""

import json
import re
import shlex
from pathlib import Path

import pytest

from air_router.cli.cli import main
from air_router.coverage.camera import CAMERAS
from air_router.mission.loading import load_mission
from air_router.preflight.check_facts import facts_of
from air_router.preflight.survey import MissionSurvey
from air_router.routing.graph import WaypointGraph

ROOT = Path(__file__).parents[2]
DOCS = {name: (ROOT / "docs" / f"{name}.md").read_text() for name in ("coverage", "coming-home")}
COMMANDS = [
    line.strip()
    for text in DOCS.values()
    for line in text.splitlines()
    if line.startswith("    air-router ")
]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_run(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "missions").symlink_to(ROOT / "missions")
    (field,) = re.findall(r"```json\n(.*?)```", DOCS["coverage"], re.DOTALL)
    (tmp_path / "field.geojson").write_text(field)
    assert main(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out


def test_the_snippet_runs(capsys):
    (snippet,) = re.findall(r"```python\n(.*?)```", DOCS["coverage"], re.DOTALL)
    exec(compile(snippet, "coverage.md", "exec"), {})  # noqa: S102 - our own
    assert capsys.readouterr().out.startswith("100.0% by ")


def test_every_camera_is_named():
    (names,) = re.findall(r"\* a name: (.*?) \(sensor", DOCS["coverage"], re.DOTALL)
    assert {name.strip() for name in names.split(",")} == set(CAMERAS)


def test_every_key_is_documented(capsys):
    text = (ROOT / "docs" / "commands.md").read_text()
    mission = load_mission(ROOT / "missions" / "pennovation" / "mission.yaml")
    facts = facts_of(MissionSurvey(WaypointGraph(mission)))
    assert json.loads(json.dumps(facts)) == facts
    for key in (*facts, *facts["home"], *facts["tightest_leg"]):
        if key != "endurance_s":
            assert f"`{key}`" in text, key
    assert main(["cover", str(mission.path), "--camera", "60x45deg", "--json"]) == 0
    for key in json.loads(capsys.readouterr().out):
        assert f"`{key}`" in DOCS["coverage"], key
