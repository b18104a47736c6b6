import math

from air_router.controller.targets.seeking import Freshest, SeekContext
from air_router.controller.targets.target_list import TargetList
from geo.frame import Point
from mocha_link.links.metrics import Direction
from sitl.experiment.robots.controllers import Orienteering

SPEED_M_S = 5.0
PLACES = {"a": Point(-100, 0), "b": Point(130, 0), "c": Point(140, 0), "d": Point(150, 0)}


def heard(*names):
    """All met at once, then not any more."""
    targets = TargetList(names)
    for name in names:
        targets.tracks[name].pose_heard(PLACES[name], 1e9, 0.0)
        for direction in Direction:
            targets.tracks[name].synced(direction, 0.0)
    return targets


def order(policy, targets, *, walled=()):
    def flight_s(place):
        return math.inf if place in walled else math.hypot(*place) / SPEED_M_S

    context = SeekContext(300.0, 0.0, flight_s, unseen=Point(0, 50), round_s=10.0)
    return [place.robot for place in policy.order(targets, context)]


def test_three_robots_side_by_side_come_before_a_nearer_one_that_is_alone():
    everyone = heard(*PLACES)
    assert order(Freshest(), everyone)[0] == "a"
    assert order(Orienteering(SPEED_M_S), everyone) == ["b", "a", "c", "d"]
    assert order(Orienteering(SPEED_M_S, {"a": 9.0}), everyone)[0] == "a"
    assert order(Orienteering(SPEED_M_S), heard("a", "b"))[0] == "a"  # b alone is farther


def test_where_no_way_leads_or_another_uav_goes_it_seeks_no_robot_first():
    everyone = heard(*PLACES)
    assert order(Orienteering(SPEED_M_S), everyone, walled=[PLACES["b"]])[-1] == "b"
    everyone.sought_by_other("uav02", "b", 300.0)
    assert order(Orienteering(SPEED_M_S), everyone)[-1] == "b"
    assert order(Orienteering(SPEED_M_S), everyone, walled=list(PLACES.values()))[-1] == "b"
    assert order(Orienteering(SPEED_M_S), TargetList(())) == []
