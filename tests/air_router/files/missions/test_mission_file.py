"""The errors of a wrong mission file: every problem at once, each with its place."""

import re
import textwrap
from pathlib import Path

import pytest

from air_router.errors import exit_code
from air_router.files.mission_form import FrameForm, MissionForm, PlannerSettings, Timers
from air_router.mission.loading import load_mission
from geo.airspace.zone import Band
from mocha_link.team.document import DocumentError

MISSIONS = Path(__file__).parents[4] / "missions"

TOWN = """\
name: Test town
coordinates: local
frame: {origin: [38.5, -98.5]}
home: [0, 0]
altitude_m: 30
speed_m_s: 4
waypoints:
  - [50, 0]
  - [50, 50]
  - {position: [-50, 50], altitude_m: 25}
fence: [[-100, -100], [100, -100], [100, 100], [-100, 100]]
no_fly_zones:
  - {name: hall, polygon: [[-20, 20], [20, 20], [20, 40], [-20, 40]]}
  - {name: mast, circle: {centre: [50, -50], radius_m: 10}}
"""


def write(folder, text):
    path = folder / "mission.yaml"
    path.write_text(textwrap.dedent(text))
    return path


def problems(folder, text):
    with pytest.raises(DocumentError) as caught:
        load_mission(write(folder, text))
    assert all(re.fullmatch(r"[a-z]+(-[a-z]+)+", p.code) for p in caught.value.problems)
    return [
        str(p).removeprefix(f"{folder}/mission.yaml:").removesuffix(f" [{p.code}]")
        for p in caught.value.problems
    ]


def changed(*changes):
    text = TOWN
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return text


def test_a_small_mission_with_defaults(tmp_path):
    mission = load_mission(write(tmp_path, TOWN))
    assert mission.name == "Test town"
    assert mission.home == (0, 0)
    assert [w.number for w in mission.waypoints] == [1, 2, 3]
    assert [w.altitude_above_home_m for w in mission.waypoints] == [30, 30, 25]
    assert mission.waypoints[2].position == (-50, 50)
    assert [zone.name for zone in mission.zones] == ["hall", "mast"]
    assert mission.timers == Timers(180, 120, 45, 20)
    assert mission.planner == PlannerSettings()
    assert mission.airspace.clearance_m == 5
    assert mission.planning_airspace.distances_m == (6.55, 6.55)  # at 4 m/s a bit more than 1.5
    assert mission.planning_airspace.fence_distance_m == 6.55
    assert (mission.team, mission.uav, mission.seek, mission.duration_s) == (None, None, (), None)
    assert mission.frame.to_geodetic(mission.home) == pytest.approx((38.5, -98.5))


@pytest.mark.parametrize(
    ("seek", "robots", "policy"),
    [
        ("[io, europa]", ("io", "europa"), "round_robin"),
        ("freshest", (), "freshest"),
        ("{policy: rendezvous}", (), "rendezvous"),
        ("{robots: [io], policy: round_robin}", ("io",), "round_robin"),
        ("{robots: [io]}", ("io",), "round_robin"),
        ("[]", (), "round_robin"),
    ],
)
def test_whom_to_seek_and_how(tmp_path, seek, robots, policy):
    mission = load_mission(write(tmp_path, TOWN + f"seek: {seek}\n"))
    assert (mission.seek, mission.seek_policy) == (robots, policy)


def test_degrees_are_relative_to_home_unless_the_file_has_others(tmp_path):
    text = """\
        home: [47.0, 8.0]
        altitude_m: 20
        waypoints: [[47.0005, 8.0]]
        fence: null
        no_fly_zones: []
        """
    mission = load_mission(write(tmp_path, text))
    assert mission.name == tmp_path.name
    assert mission.home == (0, 0)
    assert mission.waypoints[0].position == pytest.approx((0, 55.6), abs=0.1)
    assert mission.fences == ()
    moved = load_mission(write(tmp_path, text + "frame: {origin: [47.001, 8.0]}\n"))
    assert moved.home == pytest.approx((0, -111.2), abs=0.1)


def test_a_walled_in_waypoint_names_the_walls(tmp_path):
    walls = """\
no_fly_zones:
  - {name: south, polygon: [[-80, 20], [-20, 20], [-20, 25], [-80, 25]]}
  - {name: north, polygon: [[-80, 75], [-20, 75], [-20, 80], [-80, 80]]}
  - {name: west, polygon: [[-80, 24], [-75, 24], [-75, 76], [-80, 76]]}
  - {name: east, polygon: [[-25, 24], [-20, 24], [-20, 76], [-25, 76]]}
"""
    (found,) = problems(tmp_path, TOWN.partition("no_fly_zones")[0] + walls)
    assert found.startswith(
        "10:16: no clear way leads from home to waypoint 3: 'south' and 'north' and 'west' and "
        "'east' leave no room at 6.55 m (clearance 5 m + tracking margin 1.55 m); open a gap"
    )


def test_all_problems_are_reported_at_once_in_file_order(tmp_path):
    (tmp_path / "team.yaml").write_text((MISSIONS / "urban" / "team.yaml").read_text())
    text = changed(
        ("name: Test town", "team: team.yaml\nseek: [calisto, titan]"),
        ("speed_m_s: 4", "speed: 4"),
        ("- [50, 0]", "- [50, zero]"),
        ("- [50, 50]", "- [0, 30]"),
        ("altitude_m: 25", "altitude_m: -1"),
        ("radius_m: 10", "radius_m: 0"),
    )
    assert [problem.split(";")[0] for problem in problems(tmp_path, text)] == [
        "2:8: the team has no robot 'calisto'",
        "2:17: 'titan' flies this mission",
        "7:1: unknown key 'speed'",
        "9:10: 'waypoints[0].position[1]' must be a number, found text 'zero'",
        "10:5: waypoint 2 lies inside no-fly zone 'hall'",
        "11:39: 'waypoints[2].altitude_m' must be at least 1.0, found -1",
        "15:56: 'no_fly_zones[1].circle.radius_m' must be greater than 0.0, found 0",
    ]


def test_without_home_the_rest_is_still_checked(tmp_path):
    text = changed(("home: [0, 0]\n", ""), ("- [50, 50]", "- [0, 30]"))
    assert [problem.split(";")[0] for problem in problems(tmp_path, text)] == [
        "1:1: missing key 'home' (where the vehicle takes off and lands)",
        "8:5: waypoint 2 lies inside no-fly zone 'hall'",
    ]


def test_problems_of_the_team_file_are_reported_with_its_name(tmp_path):
    (tmp_path / "team.yaml").write_text("robots: {}\nkinds: {}\n")
    with pytest.raises(DocumentError) as caught:
        load_mission(write(tmp_path, changed(("name: Test town", "team: team.yaml"))))
    assert str(caught.value).startswith(f"{tmp_path}/team.yaml:1:9:")
    assert exit_code(caught.value) == 3


def test_the_teams_only_uav_is_meant_when_none_is_named(tmp_path):
    (tmp_path / "team.yaml").write_text((MISSIONS / "urban" / "team.yaml").read_text())
    mission = load_mission(write(tmp_path, changed(("name: Test town", "team: team.yaml"))))
    assert mission.uav == "titan"
    text = changed(("name: Test town", "team: team.yaml\nuav: titn"))
    assert problems(tmp_path, text) == ["2:6: the team has no robot 'titn'; did you mean 'titan'?"]


def test_goals_come_from_robots_that_the_team_has_and_that_can_send_some(tmp_path):
    names = ("io", "titan", "oi")
    team = (MISSIONS / "pennovation" / "team.yaml").read_text()
    (tmp_path / "team.yaml").write_text(team)
    text = TOWN + f"team: team.yaml\ngoals_from: [{', '.join(names)}]\n"
    found = problems(tmp_path, text)
    assert ["take it off the list" in found[0], "no robot 'oi'" in found[1]] == [True, True]
    mission = load_mission(write(tmp_path, text.replace(", titan, oi", "")))
    assert mission.goals_from == ("io",)
    assert [note.code for note in mission.notes] == ["no-goals-topic"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "1:1: a mission is a mapping of keys and values"),
        ("- 1\n", "1:1: a mission is a mapping of keys and values"),
        ("waypoints: 3\n", "1:12: 'waypoints' must be a list, found 3"),
    ],
)
def test_what_is_no_mission_at_all(tmp_path, text, expected):
    assert any(problem.startswith(expected) for problem in problems(tmp_path, text))


def test_no_waypoints(tmp_path):
    text = TOWN.replace("waypoints:", "waypoints: []").replace("  - [50, 0]\n  - [50, 50]\n", "")
    text = text.replace("  - {position: [-50, 50], altitude_m: 25}\n", "")
    assert problems(tmp_path, text) == ["7:12: a mission needs at least one waypoint; add one"]


def test_the_documented_examples_load_and_the_table_has_every_key(tmp_path):
    text = (MISSIONS.parent / "docs" / "mission-file.md").read_text()
    shortest, areas, glider = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    assert len(load_mission(write(tmp_path, shortest)).waypoints) == 2
    longer = shortest.replace("fence: null\nno_fly_zones: []\n", areas)
    assert len(load_mission(write(tmp_path, longer)).zones) == 2
    timed = shortest.replace("no_fly_zones: []\n", glider)
    (zone,) = load_mission(write(tmp_path, timed)).zones
    assert (zone.clearance_m, zone.band) == (20, Band(10, 320))
    assert len(zone.validity.periods) == 2
    documented = set(
        re.findall(r"^\| \**`([a-z_.]+)`", text.partition("## Areas")[0], re.MULTILINE)
    )
    nested = {"frame", "timers", "planner"}
    known = set(MissionForm.model_fields) - nested
    for name in nested:
        inner = {"frame": FrameForm, "timers": Timers, "planner": PlannerSettings}[name]
        known |= {f"{name}.{key}" for key in inner.__annotations__}
    assert documented == known
