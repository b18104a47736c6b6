"""How far a vehicle may be off its legs, and what a mission keeps for that."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.mission_form import PlannerSettings
from air_router.mission.loading import load_mission
from air_router.mission.tracking import PLAN_M, TrackingMargin, tracking_error_m
from geo.frame import Point
from tests.air_router.conftest import MISSIONS

SPEEDS = st.floats(1.0, 15.0)
WINDS = st.floats(0.0, 20.0)
ACCURACIES = st.floats(0.1, 10.0)


def settings(**changes):
    return dataclasses.replace(PlannerSettings(), **changes)


@given(SPEEDS, WINDS, ACCURACIES, st.floats(0.1, 3.0))
def test_it_is_no_less_off_faster_in_more_wind_or_with_poorer_satellites(
    speed, wind, accuracy, more
):
    least_m = tracking_error_m(speed, wind, accuracy)
    assert tracking_error_m(speed + more, wind, accuracy) > least_m
    assert tracking_error_m(speed, wind + more, accuracy) >= least_m
    assert tracking_error_m(speed, wind, accuracy + more) > least_m
    assert tracking_error_m(speed, wind, accuracy, turns=True) > least_m


@pytest.mark.parametrize(
    ("speed_m_s", "seen_m"), [(2.0, 0.97), (3.5, 1.45), (5.0, 1.49), (6.5, 1.38), (8.0, 1.82)]
)
def test_what_a_real_px4_was_off_is_reckoned_with(speed_m_s, seen_m):
    """Of PX4 1.17's own simulator, in still air, with an h_acc of 0.9 m: see docs/routes.md."""
    assert TrackingMargin.of(settings(), speed_m_s).turn_m >= seen_m


@given(SPEEDS, WINDS, ACCURACIES, st.floats(0.02, 20.0))
def test_the_margin_of_the_file_is_the_least_and_the_error_is_always_covered(
    speed, wind, accuracy, floor_m
):
    planner = settings(wind_m_s=wind, position_accuracy_m=accuracy, tracking_margin_m=floor_m)
    margin = TrackingMargin.of(planner, speed)
    assert margin.planned_m >= max(floor_m, margin.turn_m)
    assert margin.turned_m >= max(floor_m / 2, margin.turn_m)
    assert margin.planned_m >= margin.turned_m >= margin.flown_m >= max(floor_m / 2, margin.error_m)
    assert margin.planned_m in {floor_m, round(margin.turn_m + PLAN_M, 2)}


def test_at_the_default_speed_the_margin_is_that_of_the_file(pennovation):
    assert pennovation.speed_m_s == 3.5
    assert pennovation.planning_airspace.margin_m == pennovation.planner.tracking_margin_m == 1.5


@pytest.mark.parametrize("name", ["pennovation", "urban", "pair", "explorers", "large"])
def test_shipped_missions_are_planned_with_what_their_vehicle_may_be_off(name):
    mission = load_mission(MISSIONS / name / "mission.yaml")
    assert mission.planning_airspace.margin_m >= mission.tracking.turn_m
    assert mission.planning_distance_m == mission.planner.clearance_m + mission.tracking.planned_m


@pytest.mark.parametrize(
    ("line", "longer"),
    [
        ("speed_m_s: 8", True),
        ("planner: {wind_m_s: 10}", True),
        ("planner: {position_accuracy_m: 2}", True),
        ("planner: {wind_m_s: 0}", False),
    ],
)
def test_a_faster_or_less_sure_mission_keeps_farther_away_everywhere(tmp_path, line, longer):
    text = (
        "coordinates: local\nframe: {origin: [38.5, -98.5]}\nhome: {position: [0, -50]}\n"
        "altitude_m: 30\nwaypoints: [[-60, -50], [60, -50]]\nfence: [[-200, -200], [200, -200], "
        "[200, 200], [-200, 200]]\n"
        "no_fly_zones:\n  - {name: hall, polygon: [[-10, 0], [10, 0], [10, 20], [-10, 20]]}\n"
    )
    plain, changed = tmp_path / "plain.yaml", tmp_path / "changed.yaml"
    plain.write_text(text)
    changed.write_text(text + line + "\n")
    before, after = load_mission(plain), load_mission(changed)
    assert (after.tracking.planned_m > before.tracking.planned_m) is longer
    redrawn = after.with_areas(after.fences, after.zones)
    for mission in (after, redrawn):
        assert mission.planning_airspace.margin_m == after.tracking.planned_m
        assert mission.planning_airspace.fence_distance_m == after.planning_distance_m
    place = Point(0.0, -before.planning_distance_m - 0.01)
    assert after.planning_airspace.point_clear(place) is not longer
