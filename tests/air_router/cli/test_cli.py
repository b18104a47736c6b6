"""The commands check and plan: what they print where, and their exit codes."""

import json
import math
from pathlib import Path

import pytest

from air_router.cli.cli import main
from air_router.mission.loading import load_mission

ROOT = Path(__file__).parents[3]
PENNOVATION = ROOT / "missions" / "pennovation" / "mission.yaml"
PLAN = ROOT / "tests" / "data" / "pennovation.plan"
PNG = b"\x89PNG\r\n\x1a\n"


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_check_prints_what_to_expect(capsys):
    code, out, err = run(capsys, "check", PENNOVATION)
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == (
        "Pennovation: 39 waypoints, 8 no-fly zones, a fence, 5 rally points"
    )
    assert "150 clear connections up to 100 m, 0 detours, in one piece" in out
    assert "6 to 7 by way of 3, because of zone 8" in out
    assert "titan flies and seeks callisto, europa, io (round_robin)" in out


def test_check_for_scripts(capsys):
    code, out, err = run(capsys, "check", "--json", PLAN)
    facts = json.loads(out)
    assert (code, err) == (0, "")
    assert facts["valid"] is True
    assert (facts["waypoints"], facts["zones"], facts["rally_points"]) == (39, 8, 5)
    assert facts["connected"] is True
    assert facts["stranded"] == []
    assert facts["tightest_leg"]["distance_m"] >= facts["planning_distance_m"] - 1e-3
    assert 1800 < facts["path_length_m"] < 2600
    assert facts["flight_time_s"] > facts["path_length_m"] / 3.5


def broken(folder):
    path = folder / "mission.yaml"
    text = PENNOVATION.read_text().replace("speed_m_s: 3.5", "speed_m_s: swift")
    text = text.replace("team: team.yaml", "").replace("world: world.yaml", "")
    path.write_text(text.replace("crosses_fence: true", "crosses_fence: false"))
    return path


def test_check_lists_all_problems_to_people_and_to_scripts(capsys, tmp_path):
    path = broken(tmp_path)
    code, out, err = run(capsys, "check", "--json", path)
    answer = json.loads(out)
    assert code == 3
    assert answer["valid"] is False
    first, second = err.splitlines()
    assert "'speed_m_s' must be a number, found text 'swift'" in first
    assert "no-fly zone 'zone 4' crosses the fence" in second
    assert run(capsys, "check", path) == (3, "", err)
    lines = path.read_text().splitlines()
    for problem, line in zip(answer["problems"], err.splitlines(), strict=True):
        assert problem["path"] == str(path)
        where = f"{path}:{problem['line']}:{problem['column']}: "
        assert line == f"{where}{problem['message']} [{problem['code']}]"
        assert lines[problem["line"] - 1]


def test_plan_prints_the_legs(capsys):
    code, out, err = run(capsys, "plan", PENNOVATION, "--from", 1, "--to", 34)
    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert [line.split()[:2] for line in lines[1:-1]] == [["1", "19"], ["19", "38"], ["38", "34"]]
    assert lines[-1].startswith("205.6 m, about ")
    assert lines[-1].endswith("; closest approach 6.9 m to zone 5")


def test_plan_for_scripts(capsys):
    code, out, _ = run(capsys, "plan", PENNOVATION, "--from", 0, "--to", 34, "--json")
    facts = json.loads(out)
    assert code == 0
    assert (facts["from"], facts["to"]) == (0, 34)
    assert facts["legs"][-1]["node"] == 34
    assert facts["length_m"] == pytest.approx(
        sum(leg["length_m"] for leg in facts["legs"]), abs=0.01
    )
    assert facts["closest_approach_m"] == min(leg["closest_m"] for leg in facts["legs"])
    assert facts["closest_approach_m"] >= 6.5
    assert facts["legs"][-1]["latitude_deg"] == pytest.approx(39.9410544)


def test_plan_between_any_places(capsys):
    here, there = "39.9427,-75.2013", "39.9410,-75.1990"
    code, out, err = run(capsys, "plan", PENNOVATION, "--from", here, "--to", there)
    lines = out.splitlines()
    assert (code, err) == (0, "")
    assert lines[1].split()[0] == "start"
    assert lines[-2].split()[1] == "goal"
    code, out, _ = run(capsys, "plan", PENNOVATION, "--from", here, "--to", 0, "--json")
    assert json.loads(out)["from"] == [39.9427, -75.2013]
    assert json.loads(out)["legs"][-1]["node"] == 0


def test_plan_prints_why_there_is_no_route(capsys):
    inside = "39.9415,-75.2005"  # zone 2
    code, out, err = run(capsys, "plan", PENNOVATION, "--from", 1, "--to", inside)
    assert (code, out) == (1, "")
    reason, place = err.rstrip().split("; the nearest place to hover is ")
    assert (
        reason == "no route from 1 to 39.9415,-75.2005: the goal lies inside no-fly zone 'zone 2'"
    )
    hover, away = place.split(", ")
    code, out, err = run(capsys, "plan", PENNOVATION, "--from", 1, "--to", hover)
    assert (code, err) == (0, "")
    zone = load_mission(PENNOVATION).frame.to_local(39.9415, -75.2005)
    beside = load_mission(PENNOVATION).frame.to_local(*map(float, hover.split(",")))
    assert away == f"{math.dist(zone, beside):.1f} m away"
    code, out, err = run(capsys, "plan", PENNOVATION, "--from", inside, "--to", 1)
    assert code == 0
    assert "the vehicle is inside no-fly zone 'zone 2'" in err


def test_a_picture_is_drawn(capsys, tmp_path, open_air):
    target = tmp_path / "b.png"
    assert run(capsys, "plan", PENNOVATION, "--from", 0, "--to", 34, "--png", target)[0] == 0
    assert target.read_bytes().startswith(PNG)
    assert target.stat().st_size > 50_000
    for name in ("missing/folder.png", "picture.docx"):
        code, _, err = run(capsys, "check", open_air, "--png", tmp_path / name)
        assert (code, err.startswith("cannot write the picture ")) == (1, True)


@pytest.fixture
def open_air(tmp_path):
    path = tmp_path / "open.yaml"
    path.write_text(
        "home: [39.9412, -75.1992]\naltitude_m: 30\nfence: null\nno_fly_zones: []\n"
        "waypoints: [[39.9415, -75.1992]]\n"
    )
    return path


def test_without_zones_and_fence_nothing_is_near(capsys, open_air):
    code, out, _ = run(capsys, "plan", open_air, "--from", 0, "--to", 1)
    assert code == 0
    assert "inf" not in out
    assert "closest approach nothing near" in out


def test_places_in_the_southern_hemisphere_need_no_equals_sign(capsys, tmp_path):
    mission = tmp_path / "sydney.yaml"
    mission.write_text(
        "home: [-33.9000, 151.2000]\naltitude_m: 40\nwaypoints: [[-33.9010, 151.2000]]\n"
        "fence: null\nno_fly_zones: []\n"
    )
    ends = ("--from", "-33.9005,151.2005", "--to", "-33.9,151.2")
    code, out, _ = run(capsys, "plan", mission, *ends, "--json")
    assert code == 0
    assert json.loads(out)["length_m"] == pytest.approx(72.3, abs=0.5)
    assert run(capsys, "plan", mission, "--from", "-1", "--to", "0")[0] == 2


def test_names_do_not_reach_into_the_terminal(capsys, tmp_path):
    mission = tmp_path / "mission.yaml"
    mission.write_text(r"""
name: "a\0b\e[31m c"
home: [46.52, 6.56]
altitude_m: 40
waypoints: [[46.521, 6.561]]
fence: null
no_fly_zones: [{name: "p\u202Eo\n\e[2Jnd", circle: {centre: [46.5203, 6.5603], radius_m: 5}}]
""")
    code, out, err = run(capsys, "check", mission, "--png", tmp_path / "mission.png")
    assert (code, err) == (0, f"drawn: {tmp_path / 'mission.png'}\n")
    assert out.startswith("a?b?[31m c: 1 waypoint, 1 no-fly zone, no fence, 0 rally points\n")
    middle = "46.5203,6.5603"
    _, _, err = run(capsys, "plan", mission, "--from", 0, "--to", middle)
    assert "inside no-fly zone 'p?o ?[2Jnd'" in err
    mission.write_text(mission.read_text() + '"\\e[31mred": 1\n')
    code, out, err = run(capsys, "check", mission)
    assert code == 3
    assert "\x1b" not in out + err
    assert "?[31mred" in out + err
