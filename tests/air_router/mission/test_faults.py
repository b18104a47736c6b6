"""What is drawn in red of a mission that cannot be flown."""

import json

import pytest

from air_router.cli.cli import main
from air_router.mission.loading import read_placed, validate
from air_router.mission.validation import blocked_legs, faults_of
from geo.frame import Point

PNG = b"\x89PNG\r\n\x1a\n"
SOUND = {
    "coordinates": "local",
    "frame": {"origin": [38.5, -98.5]},
    "home": [0, 0],
    "altitude_m": 40,
    "waypoints": [[60, 0], [60, 80], [-60, 80]],
    "fences": [
        [[-150, -100], [150, -100], [150, 150], [-150, 150]],
        {"circle": {"centre": [0, 20], "radius_m": 190}},
    ],
    "no_fly_zones": [
        {"name": "barn", "polygon": [[-20, 60], [20, 60], [20, 100], [-20, 100]]},
        {"name": "mast", "circle": {"centre": [30, -55], "radius_m": 6}},
        {
            "name": "pond",
            "polygon": [[-90, -60], [-40, -60], [-40, -10], [-90, -10]],
            "holes": [[[-80, -50], [-50, -50], [-50, -20], [-80, -20]]],
        },
        {"name": "high", "polygon": [[80, 0], [90, 0], [90, 20]], "altitude": {"lower_m": 100}},
        {
            "name": "past",
            "circle": {"centre": [100, 60], "radius_m": 20},
            "active": [{"until": "2020-01-01T00:00:00Z"}],
        },
    ],
}
CHANGES = {
    "waypoint in a zone": {"waypoints": [[60, 0], [0, 80], [-60, 80]]},
    "far away": {"waypoints": [[60, 0], [60_000, 0]]},
    "crossing itself": {"no_fly_zones": [[[0, 60], [40, 100], [40, 60], [0, 100]]]},
    "crossing the fence": {"no_fly_zones": [[[140, 60], [180, 60], [180, 100]]]},
    "all at once": {
        "home": [0, 80],
        "waypoints": [[60, 0], [0, 80], [26, 80], [60_000, 0], [-65, -35]],
        "rally_points": [[0, 80], [0, 20]],
        "no_fly_zones": [
            *SOUND["no_fly_zones"],
            [[0, 60], [40, 100], [40, 60], [0, 100]],
            [[140, 60], [180, 60], [180, 100]],
        ],
    },
}


def judged(folder, changes):
    path = folder / "mission.yaml"
    path.write_text(json.dumps(SOUND | changes))
    placed, findings = read_placed(path)
    return placed, findings, validate(placed, findings)


def test_illegal_places_and_the_legs_to_them(tmp_path):
    faults = faults_of(*judged(tmp_path, CHANGES["waypoint in a zone"]))
    assert [spot.label for spot in faults.spots] == ["waypoint 2"]
    barn = Point(0, 80)
    assert set(faults.legs) == {(Point(60, 0), barn), (barn, Point(-60, 80))}
    assert faults.count == 1


def test_places_that_no_sheet_shows(tmp_path):
    faults = faults_of(*judged(tmp_path, CHANGES["far away"]))
    assert faults.off_sheet == ("waypoint 2",)
    assert faults.legs == ()


def test_a_border_that_crosses_itself_is_kept_with_the_crossing(tmp_path):
    (refused,) = faults_of(*judged(tmp_path, CHANGES["crossing itself"])).refused
    assert refused.name == "no-fly zone 'zone 1'"
    assert len(refused.ring) == 4
    assert refused.place == pytest.approx((20, 80))


def test_wrong_areas(tmp_path):
    placed, findings, mission = judged(tmp_path, CHANGES["crossing the fence"])
    assert faults_of(placed, findings, mission).shapes == (placed.zones[0].shape,)


def test_legs_of_a_sound_mission_that_are_flown_around(tmp_path):
    *_, mission = judged(tmp_path, {})
    assert blocked_legs(mission) == [(Point(60, 80), Point(-60, 80))]
    assert faults_of(*judged(tmp_path, {})).count == 0


def test_a_wrong_mission_is_drawn_all_the_same(tmp_path, capsys):
    path, picture = tmp_path / "mission.yaml", tmp_path / "mission.png"
    path.write_text(json.dumps(SOUND | CHANGES["all at once"]))
    code = main(["check", str(path), "--png", str(picture)])
    assert code == 3
    assert picture.read_bytes().startswith(PNG)
    captured = capsys.readouterr()
    assert f"drawn: {picture}\n" in captured.err
