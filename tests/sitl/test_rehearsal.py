"""A small part of `make rehearse`, and the judge on its own."""

import itertools
from pathlib import Path

import pytest

from air_router.graph import WaypointGraph
from air_router.mission import load_mission
from air_router.router import Router
from geo.zone import Circle, Outline
from sitl.rehearsal.faults import FLIGHTS, Fault, Scene, scenes
from sitl.rehearsal.judge import End, Judge, Verdict, depth_m
from sitl.rehearsal.report import table
from sitl.rehearsal.stage import Stage, hurried

PENNOVATION = Path(__file__).parents[2] / "missions" / "pennovation" / "mission.yaml"
SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
HOLE = ((4.0, 4.0), (6.0, 4.0), (6.0, 6.0), (4.0, 6.0))


@pytest.fixture(scope="module")
def mission():
    return hurried(load_mission(PENNOVATION))


@pytest.fixture(scope="module")
def router(mission):
    return Router(WaypointGraph(mission))


@pytest.mark.parametrize(
    ("fault", "seed", "ends"),
    [
        (Fault.GUSTS, 3, {End.LANDED}),
        (Fault.JUMPS, 2, {End.LANDED}),
        (Fault.LOSS_20, 1, {End.LANDED}),
        (Fault.SILENCE, 4, {End.LANDED}),
        (Fault.NO_FIX, 1, {End.LANDED}),
        (Fault.HAND_BACK, 1, {End.LANDED, End.PILOT}),
        (Fault.RESTART, 2, {End.LANDED}),
        (Fault.ZONE, 0, {End.PILOT}),
        (Fault.RELOAD, 3, {End.LANDED}),
        (Fault.WALL, 0, {End.FAILSAFE}),
        (Fault.LATE, 2, {End.LANDED}),
        (Fault.OLD, 0, {End.LANDED}),
        (Fault.REQUESTS, 2, {End.LANDED}),
        (Fault.BATTERY, 0, {End.LANDED, End.FAILSAFE}),
        (Fault.UPLOAD, 1, {End.STAYED}),
    ],
)
def test_whatever_goes_wrong_it_ends_well_and_outside_of_every_zone(
    mission, router, fault, seed, ends
):
    verdict = Stage(Scene(fault, seed), mission, router).fly()
    assert verdict.good, verdict
    assert verdict.end in ends


def test_the_same_seed_is_the_same_flight(mission, router):
    first, second = (Stage(Scene(Fault.LOSS_5, 0), mission, router).fly() for _ in range(2))
    assert first == second


def test_a_whole_rehearsal_has_at_least_two_hundred_flights_of_every_fault():
    whole = scenes()
    assert len(whole) >= 200
    assert {scene.fault for scene in whole} == set(Fault) == set(FLIGHTS)
    assert all(len(scene.faults) == 2 for scene in whole if scene.fault is Fault.TWO)


@pytest.mark.parametrize(
    ("place", "depth"),
    [((5.0, 2.0), 2.0), ((5.0, 5.0), -1.0), ((12.0, 5.0), -2.0), ((13.0, 14.0), -5.0)],
)
def test_how_deep_inside_a_polygon_with_a_hole(place, depth):
    assert depth_m(Outline(SQUARE, (HOLE,)), *place) == pytest.approx(depth)


def test_how_deep_inside_a_circle():
    assert depth_m(Circle((0.0, 0.0), 5.0), 3.0, 0.0) == pytest.approx(2.0)
    assert depth_m(Circle((0.0, 0.0), 5.0), 0.0, 9.0) == pytest.approx(-4.0)


def test_the_judge_agrees_with_the_airspace_about_where_zones_are(mission):
    """Two independent answers to the same question, all over the place."""
    drawn = mission.airspace.as_drawn()
    for east, north in itertools.product(range(-300, 300, 23), repeat=2):
        judge = Judge(mission)
        judge.see((east, north), 0.1, ours=True)
        assert -judge.deepest_m == pytest.approx(drawn.distance_m((east, north)), abs=0.01)


def test_what_happens_by_somebody_else_s_command_is_not_ours(mission):
    judge = Judge(mission)
    west, south, east, north = mission.airspace.zones[0].polygon.bounds
    judge.see(((west + east) / 2, (south + north) / 2), 0.1, ours=False)
    assert judge.deepest_m < 0 < judge.deepest_other_m
    assert judge.ours_s == 0


def test_the_table():
    verdicts = [
        Verdict("GUSTS-0", "GUSTS", End.LANDED, -6.2, 200.0, expected=True),
        Verdict("GUSTS-1", "GUSTS", End.NOT, 0.5, 200.0, expected=False),
    ]
    assert [verdict.good for verdict in verdicts] == [True, False]
    text = table(verdicts)
    assert "| wind to 10 m/s with gusts | 2 | 1 | 1 | -0.5 m | 1 |" in text
    assert "**all**" in text
