"""`check`: who flies, whom it seeks, and by which topic each robot would be found."""

import json
import shutil
from pathlib import Path

import pytest

from air_router.cli.cli import main
from air_router.mission.loading import load_mission
from mocha_link.team.document import DocumentError

PLAN = Path(__file__).parents[2] / "data" / "pennovation.plan"
MISSION = """\
home: [39.9421, -75.1997]
altitude_m: 30
waypoints: [[39.9422, -75.2001]]
fence: null
no_fly_zones: []
team: team.yaml
"""
TEAM = """\
robots:
  titan: {kind: aerial_robot, address: 127.0.0.1, base_port: 24000, clients: [io, oi, base]}
  io: {kind: rover, address: 127.0.0.1, base_port: 24100, clients: [titan]}
  oi: {kind: walker, address: 127.0.0.1, base_port: 24200, clients: [titan]}
  base: {kind: base_station, address: 127.0.0.1, base_port: 24300, clients: [titan]}
kinds:
  aerial_robot: {topics: [{name: /map, type: grid/SemanticMap}]}
  rover: {topics: [{name: /fix, type: sensor_msgs/NavSatFix}]}
  walker: {topics: [{name: /pose, type: json/Pose}]}
  base_station: {topics: [{name: /goals, type: json/Goals}]}
"""
BASE = "goals_from: [base]\n"
ODOMETRY = ("/pose, type: json/Pose", "/odom, type: nav_msgs/Odometry")


def written(folder, keys=BASE, *change):
    assert not change or change[0] in TEAM
    (folder / "team.yaml").write_text(TEAM.replace(*change) if change else TEAM)
    path = folder / "mission.yaml"
    path.write_text(MISSION + keys)
    return path


def test_it_prints_by_what_each_robot_is_found(tmp_path, capsys):
    """A base station that sends goals and no position is not sought by itself."""
    path = str(written(tmp_path))
    assert main(["check", path]) == 0
    printed = capsys.readouterr().out
    assert "  found by   /fix (sensor_msgs/NavSatFix): io\n" in printed
    assert "  found by   /pose (json/Pose): oi\n" in printed
    assert main(["check", "--json", path]) == 0
    assert json.loads(capsys.readouterr().out)["found_by"] == {
        "io": {"topic": "/fix", "type": "sensor_msgs/NavSatFix"},
        "oi": {"topic": "/pose", "type": "json/Pose"},
    }


@pytest.mark.parametrize(
    ("keys", "change", "message"),
    [
        ("", (), "team.yaml:5:9: 'base' is sought, and none of its topics has its position"),
        (BASE, ODOMETRY, "team.yaml:4:7: 'oi' is sought and reports its position in metres"),
        (BASE, ("json/Pose", "my/Pose"), "'oi' is sought, and none of its topics has its position"),
        (f"{BASE}uav: io\n", (), "mission.yaml:8:6: 'io' is of kind rover in the team file and"),
        (BASE, ("aerial_robot", "drone"), "0 robots of kind aerial_robot; give the one that flies"),
        (BASE, ("kind: rover", "kind: aerial_robot"), "2 robots of kind aerial_robot; add 'uav'"),
    ],
)
def test_what_cannot_be_flown(keys, change, message, tmp_path):
    with pytest.raises(DocumentError) as caught:
        load_mission(written(tmp_path, keys, *change))
    assert message in str(caught.value)


def test_a_datum_places_odometry(tmp_path):
    written(tmp_path, BASE, *ODOMETRY)
    team = tmp_path / "team.yaml"
    placed = team.read_text().replace("kind: walker", "kind: walker, datum: [39.94, -75.2]")
    team.write_text(placed)
    assert load_mission(tmp_path / "mission.yaml").uav == "titan"
    team.write_text(placed.replace("39.94,", "139.94,"))
    with pytest.raises(DocumentError, match=r"write \[latitude, longitude\]"):
        load_mission(tmp_path / "mission.yaml")


def test_a_plan_without_a_uav_is_refused_with_its_options(tmp_path, capsys):
    """It has no key `uav`."""
    written(tmp_path, BASE, "kind: walker", "kind: aerial_robot")
    path = str(shutil.copy(PLAN, tmp_path))
    assert main(["check", path]) == 3
    assert "choose the one that flies this plan: --uav titan or --uav oi" in capsys.readouterr().err
    assert main(["check", path, "--uav", "base"]) == 3
    assert "'base' is of kind base_station" in capsys.readouterr().err
