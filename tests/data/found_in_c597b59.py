"""Faults of commit c597b59 that no program shows in seconds, as tests in the names of that commit.

    cp tests/data/found_in_c597b59.py OLD/tests/air_router/test_found.py
    PYTHONPATH=OLD python -m pytest -n 0 -c OLD/pyproject.toml OLD/tests/air_router/test_found.py

All fail there. docs/rehearsal.md names the same tests in today's names, which pass.
"""

import dataclasses
import os
import re
import signal

import pytest
from tests.air_router.test_flight import Rig
from tests.air_router.test_renewal import box

from air_router.actions import FlyToNode, HoldHere, RenewPlan, StateChanged
from air_router.behaviour import State
from air_router.events import AirspaceChanged, PlanRenewed
from air_router.inspection import GpsFix, Inspection
from air_router.ledger import Ledger, RobotAccount
from air_router.log import read
from air_router.mapper import Mapper
from air_router.vehicle import FlightMode, Telemetry
from air_router.whereabouts import Whereabouts
from geo.frame import Point
from geo.zone import Circle, Zone


def test_a_landing_whose_landed_state_comes_late_is_no_takeover(pretend):
    flight = pretend(duration_s=60.0)
    flight.take_off()
    flight.fly_to_state(State.LAND)
    flight.fly_until(lambda: flight.altitude_m < 0.1)
    flight.armed, flight.mode = False, FlightMode.MISSION  # in_air is of another stream
    flight.altitude_m = 0.0
    flight.give(flight.telemetry())
    assert not any("hands off" in text for text in flight.said)


def test_after_hands_off_breaches_are_told(pretend):
    flight = pretend()
    flight.take_off()
    flight.fly_away()
    flight.pilot_chooses(FlightMode.OTHER)
    flight.position = Point(5000.0, 0.0)
    flight.fly_until(lambda: flight.now_s > 200.0)
    assert any(text.startswith("breach of") for text in flight.said), flight.said


def test_a_lost_clearance_is_told_while_it_happens_and_held_for(pretend):
    flight = pretend(duration_s=600.0)
    flight.take_off()
    flight.fly_away()
    flight.position = next(
        place
        for east in range(-160, 110)
        for place in (Point(float(east), float(north)) for north in range(-160, 110, 7))
        if 3.0 < flight.mission.airspace.distance_m(place) < 4.5
    )
    flight.velocity = (0.0, 0.0)
    before, said = len(flight.motions), len(flight.said)
    flight.step()
    assert flight.said[said:], "it says nothing"
    assert isinstance(flight.motions[before], HoldHere)


def test_zones_that_the_controller_refused_are_not_judged_by(pennovation):
    ledger = Ledger(pennovation, Mapper(pennovation), {"io": RobotAccount()})

    def fly(*places, start_s):
        for second, (east_m, north_m) in enumerate(places):
            now_s = start_s + second
            position = Point(east_m, north_m)
            ledger.event(Telemetry(now_s, position, 40.0, armed=True, in_air=True), now_s)

    fly((0.0, 0.0), (5.0, 0.0), start_s=10.0)
    ledger.event(AirspaceChanged(pennovation.fences, pennovation.zones), 12.0)
    ledger.action(RenewPlan())
    drawn = Zone("refused", Circle(Point(5.0, 3.0), 4.0))
    ledger.event(AirspaceChanged(pennovation.fences, (*pennovation.zones, drawn)), 12.5)
    ledger.event(PlanRenewed(), 13.0)
    fly((5.0, 0.2), (5.0, 0.4), start_s=14.0)
    assert ledger.report("done", 0.0)["closest_approach_to"] != "refused"


def test_whom_it_goes_on_to_seek_was_not_sought_once_more(pretend):
    flight = pretend(explore=False, name="titan", duration_s=2000.0)
    flight.take_off()
    flight.fly_to_state(State.SEARCH)
    robot = flight.controller.robot
    known = flight.controller._crew.search.roster[robot]
    tries = known.tries
    above = box(flight.position, half_m=1.0, name="above")
    flight.give(AirspaceChanged(flight.mission.fences, (*flight.mission.zones, above)))
    flight.fly_until(lambda: any(isinstance(a, RenewPlan) for a in flight.actions), 60.0)
    flight.give(PlanRenewed())
    assert (flight.controller.state, flight.controller.robot) == (State.SEARCH, robot)
    assert known.tries == tries


def test_one_bad_stamp_blinds_to_no_robot():
    robot = Whereabouts("io")
    robot.pose_heard(Point(0.0, 0.0), 9.9e10, 15.0)
    news = [robot.pose_heard(Point(k, 0.0), 1011.0 + k, 16.0 + k) for k in range(90)]
    assert sum(news) >= 86


@pytest.fixture
def resumed(pennovation, pretend_vehicle, tmp_path):
    """What the second of two companions did and said, and when the first had it in the air.

    The first was interrupted on its way to waypoint 4.
    """
    mission = dataclasses.replace(pennovation, duration_s=200.0)
    first = Rig(mission, pretend_vehicle, tmp_path)
    began_s = []

    def is_on_its_way():
        airframe = first.vehicle.airframe
        if airframe.in_air and not began_s:
            began_s.append(airframe.now_s)
        return airframe.target == mission.waypoints[3].position

    first.at(is_on_its_way, lambda: os.kill(os.getpid(), signal.SIGINT))
    first.run()
    second = Rig(mission, pretend_vehicle, tmp_path, arm=False, resume=True)
    second.vehicle.airframe = first.vehicle.airframe
    second.vehicle.inspection = Inspection(gps=GpsFix(3, 14, 0.8), battery=0.3)
    second.run()
    *entries, _ = read(second.recorder.path)
    return entries, second.out.getvalue(), began_s[0]


def test_a_resumed_flight_goes_on_where_it_was(resumed):
    entries, _, _ = resumed
    legs = [e.value for e in entries if e.kind == "action" and isinstance(e.value, FlyToNode)]
    assert 1 not in [leg.node for leg in legs[:3]]


def test_a_resumed_flight_keeps_its_duration(resumed):
    entries, _, began_s = resumed
    home_s = next(
        e.t for e in entries if isinstance(e.value, StateChanged) and e.value.target is State.HOME
    )
    assert home_s == pytest.approx(began_s + 200.0, abs=2.0)


def test_a_resumed_flight_looks_at_the_card(resumed):
    _, said, _ = resumed
    assert re.search(r"battery +30%", said)
