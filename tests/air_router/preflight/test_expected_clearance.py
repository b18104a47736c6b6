"""What `check` expects of zones and fences at the least, by the kind of leg."""

import dataclasses

import pytest

from air_router.mission.loading import load_mission
from air_router.mission.tracking import tracking_error_m
from air_router.preflight.check_facts import facts_of, summary
from air_router.preflight.expected_clearance import LAND, expected_clearances
from air_router.preflight.survey import MissionSurvey
from air_router.routing.graph import WaypointGraph

KINDS = ("climb", "straight legs", "turns", "first legs", "go-tos", "returns", LAND)
TEXT = """\
coordinates: local
frame: {origin: [38.5, -98.5]}
home: {position: [0, 0]}
altitude_m: 30
waypoints: [[-60, 0], [-60, 40]]
fence: [[-200, -200], [200, -200], [200, 200], [-200, 200]]
no_fly_zones:
  - {name: mast, polygon: [[%s, -5], [60, -5], [60, 5], [%s, 5]], altitude: {upper_m: 12}}
"""


def mission_beside_a_mast(tmp_path, away_m):
    """A mast that ends below the mission's altitudes, so far from home."""
    path = tmp_path / "mission.yaml"
    path.write_text(TEXT % (away_m, away_m))
    return load_mission(path)


def kept(mission):
    return {kind.name: kind.kept_m for kind in expected_clearances(mission)}


def test_every_kind_of_leg_of_a_shipped_mission_keeps_its_promise(pennovation):
    expected = expected_clearances(pennovation)
    assert tuple(kind.name for kind in expected) == KINDS
    assert all(kind.short_m <= 0.0 for kind in expected)
    lines = summary(MissionSurvey(WaypointGraph(pennovation)))
    (line,) = [line for line in lines if line.startswith("  expected")]
    assert "straight legs 5.3 m, turns 5.0 m, first legs 5.0 m" in line
    assert not any("WARNING" in line for line in lines)


def test_a_straight_leg_keeps_what_the_margin_leaves_of_the_error(pennovation):
    margin = pennovation.tracking
    promised_m = pennovation.planner.clearance_m
    assert kept(pennovation)["straight legs"] == promised_m + margin.planned_m - margin.error_m
    assert kept(pennovation)["turns"] == promised_m + margin.turned_m - margin.turn_m
    assert kept(pennovation)["first legs"] == promised_m + margin.flown_m - margin.error_m


def test_without_zones_and_fence_no_clearance_is_expected(tmp_path):
    """From the climb and the landing "inf m" was expected."""
    path = tmp_path / "mission.yaml"
    path.write_text(TEXT.partition("fence:")[0] + "fence: null\nno_fly_zones: []\n")
    mission = load_mission(path)
    lines = summary(MissionSurvey(WaypointGraph(mission)))
    assert not [line for line in lines if line.startswith("  expected") or "inf m" in line]


@pytest.mark.parametrize(("away_m", "short"), [(7.0, True), (9.0, False)])
def test_a_landing_that_may_begin_too_near_to_a_low_zone_is_warned_of(tmp_path, away_m, short):
    mission = mission_beside_a_mast(tmp_path, away_m)
    hovers_m = tracking_error_m(0.0, 5.0, 1.0)
    assert kept(mission)["climb"] == pytest.approx(away_m - hovers_m)
    assert kept(mission)[LAND] == pytest.approx(away_m - hovers_m - 3.0)
    survey = MissionSurvey(WaypointGraph(mission))
    warned = [line for line in summary(survey) if "WARNING" in line]
    assert bool(warned) is short
    if short:
        assert "landing: 3.02 m of no-fly zone 'mast', 5 m are promised; move home" in warned[0]
    assert facts_of(survey)["expected_clearance_m"][LAND] == pytest.approx(kept(mission)[LAND])


def test_worse_conditions_to_plan_for_leave_the_promise_as_it_is(pennovation):
    planner = dataclasses.replace(pennovation.planner, wind_m_s=10.0, position_accuracy_m=3.0)
    mission = dataclasses.replace(pennovation, planner=planner)
    assert mission.tracking.planned_m > 3.0
    expected = [kind for kind in expected_clearances(mission) if kind.name not in {"climb", LAND}]
    assert all(kind.short_m <= 0.0 for kind in expected)
