import math
import random
from itertools import permutations

import pytest

from air_router.controller.targets.seeking import Freshest, SeekContext
from air_router.controller.targets.target_list import TargetList
from air_router.controller.targets.tour import TourStop, rate
from geo.frame import Point
from mocha_link.links.metrics import Direction
from sitl.experiment.robots.baselines import Orienteering, PlannedRendezvous

SPEED_M_S = 5.0
PLACES = {"a": Point(-100, 0), "b": Point(130, 0), "c": Point(140, 0), "d": Point(150, 0)}


def targets_of(*names):
    """All met at once, then not any more."""
    targets = TargetList(names)
    for name in names:
        targets.tracks[name].pose_received(PLACES[name], 1e9, 0.0)
        for direction in Direction:
            targets.tracks[name].synced(direction, 0.0)
    return targets


def context_of(round_s, *, walled=()):
    def flight_s(place):
        return math.inf if place in walled else math.hypot(*place) / SPEED_M_S

    def leg_s(start, end):
        return math.dist(start, end) / SPEED_M_S

    return SeekContext(300.0, 0.0, flight_s, leg_s, flight_s, unseen=Point(0, 50), round_s=round_s)


def order(policy, targets, *, walled=()):
    return [place.robot for place in policy.order(targets, context_of(10.0, walled=walled))]


def test_three_robots_side_by_side_come_before_a_nearer_one_that_is_alone():
    everyone = targets_of(*PLACES)
    assert order(Freshest(), everyone)[0] == "a"
    assert order(Orienteering(SPEED_M_S), everyone) == ["b", "a", "c", "d"]
    assert order(Orienteering(SPEED_M_S, {"a": 9.0}), everyone)[0] == "a"
    assert order(Orienteering(SPEED_M_S), targets_of("a", "b"))[0] == "a"  # b alone is farther


def test_where_no_way_leads_or_another_uav_goes_it_seeks_no_robot_first():
    everyone = targets_of(*PLACES)
    assert order(Orienteering(SPEED_M_S), everyone, walled=[PLACES["b"]])[-1] == "b"
    everyone.sought_by_other("uav02", "b", 300.0)
    assert order(Orienteering(SPEED_M_S), everyone)[-1] == "b"
    assert order(Orienteering(SPEED_M_S), everyone, walled=list(PLACES.values()))[-1] == "b"
    assert order(Orienteering(SPEED_M_S), TargetList(())) == []


@pytest.mark.parametrize("seed", range(4))
def test_the_planned_tour_is_the_best_of_all(seed):
    chance = random.Random(seed)
    stops = []
    for name in "abcd":
        place = Point(chance.uniform(-200, 200), chance.uniform(-200, 200))
        flight_s = math.hypot(*place) / SPEED_M_S
        stops.append(TourStop(name, (place,), chance.uniform(0, 300), flight_s))
    context = context_of(30.0)
    ways = [way for count in range(1, 5) for way in permutations(stops, count)]
    best = max(rate(way, context) for way in ways)
    assert rate(PlannedRendezvous()._best(stops, context), context) == pytest.approx(best)


def test_without_anything_to_gain_nothing_is_planned():
    assert PlannedRendezvous()._best([], context_of(30.0)) == ()
