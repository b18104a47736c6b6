"""What is announced while a pilot or a failsafe has the vehicle."""

import pytest

from air_router.controller.model.actions import (
    ControlHolder,
    HoldHere,
)
from air_router.controller.model.limits import ESCALATES_S, REPEATED_S
from air_router.controller.model.states import State
from air_router.vehicle.instructions import (
    TAKE_OVER_BLIND,
    TAKE_OVER_NOW,
    TAKE_WHERE_IT_HOLDS,
    WATCH_FAILSAFE,
    Severity,
)
from air_router.vehicle.vehicle import (
    Ages,
    FlightMode,
    PlanCompared,
    PlanReplaced,
)
from geo.frame import Point

WRONG = "the vehicle is a fixed wing (MAV_TYPE 1); only multicopters are flown"


def test_after_hands_off_breaches_are_announced_again_and_again_until_they_end(away):
    flight = away()
    flight.pilot_chooses(FlightMode.OTHER)
    inside = flight.position
    flight.position = Point(5000.0, 0.0)
    flight.fly_for(25.0)
    assert sum(text.startswith("breach of") for text in flight.announced) == 3  # every ten seconds
    flight.position = inside
    flight.step()
    assert flight.announced[-1].startswith("over: breach of")
    assert flight.motions[-1].__class__ is not HoldHere


def test_a_breach_flown_by_hand_before_the_hand_over_is_announced(pretend):
    flight = pretend(pilot_arms=True)
    flight.take_off_halfway(FlightMode.POSITION)
    zone = flight.mission.climb_airspace.zones[0]
    flight.position = Point(*zone.polygon.representative_point().coords[0])
    flight.fly_for(1.0)
    flight.position = flight.mission.home
    flight.fly_for(1.0)
    breach = f"breach of {zone.name}"
    assert [text for text in flight.announced if "breach" in text] == [breach, f"over: {breach}"]
    assert (flight.controller.state, flight.motions) == (State.READY, [])


def test_a_failsafe_that_shows_after_its_mode_is_not_announced_as_the_pilot_s_choice(away):
    flight = away()
    flight.pilot_chooses(FlightMode.HOLD)
    flight.failsafe = True
    flight.step()
    assert flight.announced[-1] == "it was an autopilot failsafe that chose Hold mode"
    flight.mode = FlightMode.LAND
    flight.ends()
    assert flight.finished.taken_by is ControlHolder.FAILSAFE


def test_a_failsafe_that_goes_on_to_another_mode_is_alarmed_of(away):
    """A lost RC link: PX4 holds for some seconds, then returns, straight."""
    flight = away()
    flight.mode, flight.failsafe = FlightMode.HOLD, True
    flight.fly_for(3.0)
    assert flight.announced[-1] == "hands off: an autopilot failsafe chose Hold mode"
    flight.mode = FlightMode.RETURN
    flight.fly_for(3.0)
    (alarm,) = [a for a in flight.announcements if "changed from" in a.text]
    assert alarm.text == "an autopilot failsafe changed from Hold to Return mode"
    assert (alarm.severity, alarm.instruction) == (Severity.ALARM, WATCH_FAILSAFE)
    flight.failsafe = False  # as a HEARTBEAT may flicker
    flight.step()
    flight.failsafe = True
    flight.fly_for(1.0)
    flight.mode = FlightMode.LAND
    flight.fly_for(1.0)
    assert flight.announced[-1] == "an autopilot failsafe changed from Return to Land mode"
    assert len([text for text in flight.announced if "an autopilot failsafe" in text]) == 3


def test_a_failsafe_while_the_pilot_has_the_vehicle_is_alarmed_of(away):
    flight = away()
    flight.pilot_chooses(FlightMode.POSITION)
    flight.fly_for(10.0)
    flight.mode, flight.failsafe = FlightMode.RETURN, True
    flight.fly_for(1.0)
    assert flight.announced[-1] == "an autopilot failsafe chose Return mode"
    flight.pilot_chooses(FlightMode.POSITION)
    flight.failsafe = False
    flight.fly_for(1.0)
    flight.mode, flight.failsafe = FlightMode.RETURN, True
    flight.fly_for(1.0)
    assert [text for text in flight.announced if "chose Return" in text] == [
        flight.announced[-1]
    ] * 2


def dead_reckoned(flight):
    """In PX4's failsafe without satellites, by a position that drifts into a zone."""
    zone = flight.mission.climb_airspace.zones[0]
    flight.mode, flight.failsafe, flight.fix = FlightMode.LAND, True, False
    flight.shown["position"] = Point(*zone.polygon.representative_point().coords[0])
    flight.shown["altitude_m"] = 40.0


def test_without_a_fix_no_breach_is_claimed_and_the_unknown_position_is_alarmed_of(away):
    flight = away()
    dead_reckoned(flight)
    flight.fly_for(25.0)
    assert not [text for text in flight.announced if "breach" in text]
    known = "the vehicle's position is not known: GPS has no fix; it may be in a zone"
    alarms = [a for a in flight.announcements if a.about == "position unknown"]
    assert [a.text for a in alarms] == [known, "the vehicle's position has not been known for 12 s"]
    assert [a.instruction for a in alarms] == [TAKE_OVER_BLIND, TAKE_OVER_NOW]
    assert {a.severity for a in alarms} == {Severity.ALARM}
    flight.fix = True
    flight.fly_for(1.0)
    assert "the vehicle's position is known again" in flight.announced
    assert [text for text in flight.announced if "breach" in text]


def test_a_pilot_who_flies_by_hand_without_a_fix_is_not_alarmed_of_it(away):
    flight = away()
    dead_reckoned(flight)
    flight.mode, flight.failsafe = FlightMode.ALTITUDE, False
    flight.fly_for(25.0)
    assert not [text for text in flight.announced if "breach" in text or "not known" in text]


@pytest.mark.parametrize(("accuracy_m", "known"), [(3.0, True), (9.0, False)])
def test_a_breach_is_claimed_by_satellites_that_are_good_enough(away, accuracy_m, known):
    flight = away()
    dead_reckoned(flight)
    flight.fix, flight.shown["accuracy_m"] = True, accuracy_m
    flight.fly_for(5.0)
    assert any("breach" in text for text in flight.announced) is known
    assert any("GPS accuracy 9 m" in text for text in flight.announced) is not known


def alarmed(flight):
    return [a.instruction for a in flight.announcements if a.severity is Severity.ALARM]


def test_a_vehicle_that_no_pilot_takes_after_hands_off_is_alarmed_of_until_a_pilot_flies_it(away):
    flight = away(duration_s=None)
    flight.give(PlanReplaced(flight.now_s))
    flight.fly_for(2.0)
    flight.give(PlanCompared(flight.now_s, "42 items instead of 40"))
    flight.fly_until(lambda: flight.controller.state is State.PASSIVE, 10.0)
    assert alarmed(flight) == [TAKE_WHERE_IT_HOLDS]
    flight.fly_for(ESCALATES_S + REPEATED_S + 1.0)
    assert alarmed(flight) == [TAKE_WHERE_IT_HOLDS, TAKE_OVER_NOW, TAKE_OVER_NOW]
    flight.mode, flight.target = FlightMode.POSITION, None
    flight.fly_for(3 * REPEATED_S)
    assert len(alarmed(flight)) == 3


def test_a_vehicle_that_a_pilot_has_taken_is_not_alarmed_of(away):
    flight = away(duration_s=None)
    flight.mode, flight.target = FlightMode.POSITION, None
    flight.fly_for(2 * REPEATED_S)
    assert alarmed(flight) == []


def test_in_a_zone_without_its_mode_it_is_commanded_to_hold_once_the_mode_is_received_again(away):
    flight = away()
    flight.shown = {"ages": Ages(mode_s=6.0)}
    flight.fly_for(1.0)
    commanded = len(flight.motions)
    inside = flight.mission.zones[0]
    flight.position = Point(*inside.polygon.representative_point().coords[0])
    flight.fly_for(25.0)
    assert flight.motions[commanded:] == []
    assert not any(text.startswith("hands off") for text in flight.announced)
    assert any("hold is sent once the flight mode is received" in text for text in flight.announced)
    flight.shown = {}
    flight.fly_for(6.0)
    assert isinstance(flight.motions[commanded], HoldHere)
    assert f"hands off: breach of {inside.name} is not resumed by itself" in flight.announced
