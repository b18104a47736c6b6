"""The snippet and the tables of docs/editing.md are current."""

import json
import re
from pathlib import Path

from air_router.cli.cli import main
from air_router.coverage.camera import CAMERAS
from air_router.mission.loading import load_mission
from air_router.preflight.check_facts import facts_of
from air_router.preflight.survey import MissionSurvey
from air_router.routing.graph import WaypointGraph

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "editing.md").read_text()


def test_the_snippet_runs(capsys):
    (snippet,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    exec(compile(snippet, "editing.md", "exec"), {})  # noqa: S102 - our own
    assert capsys.readouterr().out.startswith("100.0% by ")


def test_help_names_every_camera(capsys):
    """The page leaves the list to `cover --help`."""
    assert main(["cover", "--help"]) == 0
    (names,) = re.findall(r"names: (.*?)\n\n", capsys.readouterr().out, re.DOTALL)
    assert set(re.sub(r"-\s+", "-", names).replace("\n", " ").split(", ")) == set(CAMERAS)


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
        assert f"`{key}`" in PAGE, key
