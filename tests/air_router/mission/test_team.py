"""The team of a mission, and of one that names none."""

import dataclasses

import pytest

from air_router.errors import RefusedError
from air_router.mission.loading import load_mission
from air_router.mission.team import ALONE, team_of
from tests.air_router.conftest import MISSIONS

SHORTEST = """\
home: [39.9421523, -75.1997644]
altitude_m: 30
waypoints: [[39.9422294, -75.2001338], [39.9426945, -75.1999767]]
fence: null
no_fly_zones: []
"""


@pytest.fixture
def shortest(tmp_path):
    path = tmp_path / "mission.yaml"
    path.write_text(SHORTEST)
    return load_mission(path)


def test_a_mission_without_a_team_is_flown_alone(shortest):
    team, uav = team_of(shortest, None)
    assert (team.path, list(team.robots), uav) == (ALONE, ["uav"], "uav")
    assert team.robot(uav).peers == ()
    named, uav = team_of(dataclasses.replace(shortest, uav="titan"), None)
    assert (list(named.robots), uav) == (["titan"], "titan")


def test_a_mission_that_seeks_robots_needs_a_team(shortest):
    with pytest.raises(RefusedError, match="seeks io, but names no team file; add `team:"):
        team_of(dataclasses.replace(shortest, seek=("io",)), None)


def test_a_team_given_beside_the_mission_counts(shortest):
    team, uav = team_of(shortest, MISSIONS / "pennovation" / "team.yaml")
    assert (uav, len(team.robots)) == ("titan", 4)
