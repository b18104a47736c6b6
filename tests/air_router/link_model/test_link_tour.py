"""A policy that hovers where links are expected, chosen by name like any other package's."""

import math
from dataclasses import replace

from air_router.link_model import LinkTour, LinkTourByPathLoss
from air_router.seek_policies import LinkSample, SeekContext, TargetList, Tour, policy_of
from geo.frame import Geodetic, Point
from geo.grid import SemanticGrid, Terrain
from mocha_link.links import Direction

SPEED_M_S = 5.0
HEIGHT_M = 40.0


def met(**places):
    """Robots that were met at the beginning, and not since."""
    targets = TargetList(tuple(places))
    for name, place in places.items():
        targets.tracks[name].pose_received(Point(*place), 1e9, 0.0)
        for direction in Direction:
            targets.tracks[name].synced(direction, 0.0)
    return targets


def context_at(here, reach_m, ground=None, now_s=300.0):
    """As measured in this flight, radios reach so far in all directions."""

    def leg_s(start, end):
        return math.dist(start, end) / SPEED_M_S

    def flight_s(place):
        return leg_s(here, place)

    robot = Point(0, 0)
    links = [
        LinkSample("a", 2.0 * n, Point(3.0 * n, 0), HEIGHT_M, robot, 3 * n < reach_m)
        for n in range(200)
    ]
    return SeekContext(
        *(now_s, 0.0, flight_s, leg_s, flight_s, Point(500, 0), 30.0),
        here=Point(*here),
        altitude_m=HEIGHT_M,
        links=links,
        ground=ground,
    )


def first(policy, targets, context):
    return next(iter(policy.order(targets, context)))


def test_one_robot_is_sought_where_it_is():
    place = first(LinkTour(), met(a=(400, 0)), context_at((0, 0), reach_m=100))
    assert (place.robot, place.position, place.over) == ("a", (400, 0), ())


def test_a_robot_below_trees_that_no_link_passed_comes_after_one_in_the_open():
    grid = SemanticGrid.blank(Geodetic(38.5, -98.5), 2.0, Point(-100, -300), Point(700, 300))
    grid.cells[:] = Terrain.ROAD
    grid.cells[:150] = Terrain.VEGETATION  # the south
    targets = met(a=(10, -200), b=(10, 200))
    context = context_at((0, -10), reach_m=250, ground=grid)
    links = [
        LinkSample("a", 2.0 * n, Point(3.0 * (n % 5), north), HEIGHT_M, Point(0, north), north > 0)
        for n in range(150)
        for north in (-150, 150)
    ]
    assert first(LinkTour(), targets, replace(context, links=links)).robot == "b"


def walled_town():
    """Road, with a wall on the west of a robot at 400 m east."""
    grid = SemanticGrid.blank(Geodetic(38.5, -98.5), 2.0, Point(-100, -300), Point(700, 300))
    grid.cells[:] = Terrain.ROAD
    grid.cells[:, 235:249] = Terrain.BUILDING
    return grid


def just_met(**places):
    targets = met(**places)
    for name, place in places.items():
        targets.tracks[name].pose_received(Point(*place), 1e9 + 299.0, 299.0)
    return targets


def test_while_it_talks_to_a_robot_it_hovers_nearer_to_others():
    targets = just_met(a=(400, 0), b=(520, 0))
    place = LinkTour().place("a", targets, context_at((400, 0), reach_m=100))
    assert place.robot == "a"
    assert 400 < place.position[0] <= 450
    assert "robots are expected" in place.reason


def test_it_does_not_go_behind_a_building_that_it_has_mapped():
    targets = just_met(a=(400, 0), b=(330, 0))
    context = context_at((400, 0), reach_m=100, ground=walled_town())
    walled = LinkTour().place("a", targets, context).position
    blind = LinkTourByPathLoss().place("a", targets, context).position
    assert walled[0] > blind[0]


def test_a_robot_that_is_alone_is_hovered_over():
    place = LinkTour().place("a", just_met(a=(400, 0)), context_at((400, 0), reach_m=60))
    assert place.position == (400, 0)


def test_every_robot_is_named_once_and_those_that_another_uav_seeks_come_last():
    targets = met(a=(100, 0), b=(200, 50), c=(-50, 80))
    targets.sought_by_other("uav02", "a", 300.0)
    order = list(LinkTour().order(targets, context_at((0, 0), reach_m=150)))
    assert sorted(place.robot for place in order) == ["a", "b", "c"]
    assert order[-1].robot == "a"
    assert "a" not in order[0].over


def test_robots_that_were_never_received_are_sought_as_by_a_tour():
    targets = TargetList(("a", "b"))
    found = list(LinkTour().order(targets, context_at((0, 0), reach_m=150)))
    assert [place.position for place in found] == [None, None]
    assert found == list(Tour().order(targets, context_at((0, 0), reach_m=150)))


def test_a_mission_may_name_it_and_it_has_no_fault():
    policy = policy_of("link_tour")
    order = policy.order(met(a=(100, 0), b=(50, 60)), context_at((0, 0), reach_m=150))
    assert sorted(place.robot for place in order) == ["a", "b"]
    assert policy.fault is None
