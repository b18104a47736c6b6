"""Satellites and wind that are worse than a mission is planned for are held for."""

import dataclasses

import pytest

from air_router.controller.limits import CONDITIONS_GOOD_S, CONDITIONS_HOME_S, CONDITIONS_WORSE_S
from air_router.controller.model.actions import Announce, FlyToNode, FlyToPoint, HoldHere, Refusal
from air_router.controller.model.interlocks_raised import Anomaly
from air_router.controller.model.requests import ChangeAltitude, ComeHome, HoldNow
from air_router.controller.model.states import State
from air_router.vehicle.instructions import CLEARANCE_UNCERTAIN, Severity
from air_router.vehicle.vehicle import FlightMode

POOR = ({"accuracy_m": 2.5}, "good to 2.5 m only, planned for 1 m")
STRONG = ({"wind_m_s": (6.0, -8.0)}, "wind of 10 m/s, planned for 5 m/s")


@pytest.fixture
def cruising(away):
    return away(duration_s=600.0)


def legs(motions):
    return [motion for motion in motions if isinstance(motion, FlyToNode | FlyToPoint)]


def warned(flight):
    return [
        (a.text, a.instruction)
        for a in flight.actions
        if isinstance(a, Announce) and a.severity is Severity.WARNING
    ]


@pytest.mark.parametrize(("shown", "words"), [POOR, STRONG])
def test_what_is_worse_than_planned_for_is_held_for_and_then_flown_on(cruising, shown, words):
    before = len(cruising.motions)
    cruising.shown = shown
    cruising.fly_for(CONDITIONS_WORSE_S + 1.0)
    assert isinstance(cruising.motions[-1], HoldHere)
    ((text, instruction),) = warned(cruising)
    assert words in text
    assert text.endswith(": holding")
    assert instruction == CLEARANCE_UNCERTAIN
    cruising.fly_for(15.0)
    assert not legs(cruising.motions[before + 1 :])
    assert len(warned(cruising)) == 1
    cruising.shown = {}
    held = len(cruising.motions)
    cruising.fly_for(CONDITIONS_GOOD_S - 1.0)
    assert len(cruising.motions) == held
    cruising.fly_for(3.0)
    assert legs(cruising.motions[held:])
    assert "as planned again" in "".join(cruising.announced)
    cruising.lands()


@pytest.mark.parametrize(
    "shown",
    [{"accuracy_m": 0.9}, {"accuracy_m": 1.2}, {"wind_m_s": (4.0, 3.0)}, {"accuracy_m": None}],
)
def test_what_is_planned_for_is_flown_on(cruising, shown):
    before = len(cruising.motions)
    cruising.shown = shown
    cruising.fly_for(20.0)
    assert not any(isinstance(motion, HoldHere) for motion in cruising.motions[before:])


def test_a_moment_of_it_is_not_held_for(cruising):
    for _ in range(4):
        cruising.shown = POOR[0]
        cruising.fly_for(CONDITIONS_WORSE_S - 0.5)
        cruising.shown = {}
        cruising.fly_for(1.0)
    assert warned(cruising) == []


@pytest.mark.parametrize("planned", [2.5, 3.0])
def test_a_mission_may_be_planned_for_it(away, pennovation, planned):
    planner = dataclasses.replace(pennovation.planner, position_accuracy_m=planned, clearance_m=3.0)
    flight = away(dataclasses.replace(pennovation, planner=planner), duration_s=600.0)
    flight.shown = POOR[0]
    flight.fly_for(20.0)
    assert warned(flight) == []


def test_what_does_not_get_better_ends_the_mission(cruising):
    cruising.shown = POOR[0]
    cruising.fly_for(CONDITIONS_WORSE_S + CONDITIONS_HOME_S + 1.0)
    assert cruising.controller.state is State.HOME
    assert "coming home: the satellites' position is good to 2.5 m only" in "".join(
        cruising.announced
    )
    cruising.lands()
    assert cruising.closest_m() >= cruising.mission.planner.clearance_m


def test_on_the_way_home_it_is_announced_and_flown_on(cruising):
    cruising.operator_requests(ComeHome())
    cruising.fly_for(1.0)
    before = len(cruising.motions)
    cruising.shown = POOR[0]
    cruising.lands()
    assert len(warned(cruising)) == 1
    assert not any(isinstance(motion, HoldHere) for motion in cruising.motions[before:])


@pytest.mark.parametrize("why", ["battery", "operator"])
def test_what_has_it_come_home_is_not_held_up(cruising, why):
    cruising.shown = POOR[0]
    cruising.fly_for(CONDITIONS_WORSE_S + 1.0)
    if why == "battery":
        cruising.battery = 0.2
        cruising.step()
    else:
        assert cruising.operator_requests(ComeHome()).accepted
    cruising.fly_for(2.0)
    assert cruising.controller.state is State.HOME
    assert legs(cruising.motions[-1:])
    cruising.lands()


def test_while_it_lasts_another_altitude_is_refused_and_a_pilot_is_left_alone(cruising):
    cruising.operator_requests(HoldNow())
    cruising.fly_for(6.0)
    cruising.shown = POOR[0]
    cruising.fly_for(CONDITIONS_WORSE_S + 1.0)
    altitude_m = cruising.mission.altitude_above_home_m
    answer = cruising.operator_requests(ChangeAltitude(altitude_m))
    assert (answer.accepted, answer.code) == (False, Refusal.BUSY)
    cruising.pilot_chooses(FlightMode.OTHER)
    cruising.fly_for(1.0)
    assert cruising.controller.state is State.PASSIVE
    assert not cruising.controller.context.interlocks.is_raised(Anomaly.CONDITIONS)
