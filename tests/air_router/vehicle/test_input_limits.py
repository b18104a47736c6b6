"""What a flight does when one input is missing while the vehicle sends the others."""

import dataclasses

import pytest

from air_router.controller.model.actions import HoldHere
from air_router.controller.model.limits import ESCALATES_S, REPEATED_S
from air_router.controller.model.requests import ComeHome
from air_router.controller.model.states import State
from air_router.vehicle.input_limits import LIMITS
from air_router.vehicle.instructions import TAKE_OVER_BLIND, TAKE_OVER_NOW, Severity
from air_router.vehicle.limits import FIX_ALARM_S
from air_router.vehicle.vehicle import Ages, FlightMode
from tests.printed import assert_printed

INPUTS = {limit.age: limit for limit in LIMITS}


class Missing:
    """Streams of a pretended vehicle that stop: the last message of each stays, and ages."""

    def __init__(self, flight, *ages):
        self._flight = flight
        self._true = flight.telemetry
        self._last = self._true()
        self._since_s = flight.now_s
        self._ages = ages
        flight.telemetry = self.telemetry

    def telemetry(self):
        now = self._true()
        changes = {"ages": Ages(**dict.fromkeys(self._ages, now.time_s - self._since_s))}
        last = self._last
        if "position_s" in self._ages:
            changes |= {
                "time_s": last.time_s,
                "position": last.position,
                "altitude_m": last.altitude_m,
                "velocity_m_s": last.velocity_m_s,
            }
        if "battery_s" in self._ages:
            changes["battery"] = last.battery
        if "mode_s" in self._ages:
            changes["mode"] = last.mode
        return dataclasses.replace(now, **changes)

    def comes_again(self):
        self._flight.telemetry = self._true


def announced(flight, *parts):
    return [text for text in flight.announced if all(part in text for part in parts)]


@pytest.mark.parametrize("age", INPUTS)
def test_what_is_missing_is_announced_at_its_limit_and_not_before(away, age):
    flight, limit = away(), INPUTS[age]
    Missing(flight, age)
    flight.fly_for(limit.announce_s - 0.5)
    assert not announced(flight, "not received")
    flight.fly_for(1.0)
    assert announced(flight, limit.words, "not received", limit.then(limit.announce_s))


@pytest.mark.parametrize("age", [age for age, limit in INPUTS.items() if limit.home_s])
def test_the_mission_ends_for_what_is_missing_too_long(away, age):
    flight, limit = away(duration_s=None), INPUTS[age]
    missing = Missing(flight, age)
    flight.fly_for(limit.home_s - 0.5)
    assert flight.controller.state is not State.HOME
    flight.fly_for(1.0)
    assert flight.controller.state is State.HOME
    assert announced(flight, "coming home", limit.words)
    if not limit.home_without:
        assert isinstance(flight.motions[-1], HoldHere)
        missing.comes_again()
    flight.lands()
    assert flight.closest_m() >= flight.mission.planner.clearance_m


def test_the_table_is_in_the_documents():
    head = "missing | message | announced after | no legs after | the mission ends after | because"
    lines = [f"| {head} |", "|---|---|---|---|---|---|"]
    for limit in LIMITS:
        stop = "" if limit.stop_s is None else f"{limit.stop_s:.0f} s: {limit.stop.value}"
        home = "" if limit.home_s is None else f"{limit.home_s:.0f} s"
        row = (limit.words, limit.message, f"{limit.announce_s:.0f} s", stop, home, limit.why)
        lines.append(f"| {' | '.join(row)} |")
    assert_printed("vehicle.md", "input limits", lines)


def test_without_positions_it_holds_and_goes_on_some_seconds_after_they_are_back(away):
    flight = away()
    missing = Missing(flight, "position_s")
    flight.fly_for(2.5)
    assert isinstance(flight.motions[-1], HoldHere)
    commanded = len(flight.motions)
    flight.fly_for(20.0)
    assert len(flight.motions) == commanded
    missing.comes_again()
    flight.fly_for(2.5)
    assert len(flight.motions) == commanded
    flight.fly_for(1.5)
    assert len(flight.motions) > commanded
    assert announced(flight, "all inputs are received again: continuing")


ALARMED = [age for age, limit in INPUTS.items() if limit.stop_s is not None]


def alarms(flight):
    return [a for a in flight.announcements if a.severity is Severity.ALARM]


@pytest.mark.parametrize("age", ALARMED)
def test_a_pilot_who_does_not_take_over_is_alerted_again_and_graver_at_a_bounded_pace(away, age):
    flight, limit = away(duration_s=None), INPUTS[age]
    missing = Missing(flight, age)
    flight.fly_for(limit.stop_s + 1.0)
    (first,) = alarms(flight)
    assert first.instruction == limit.instruction
    flight.fly_for(ESCALATES_S)
    _, second = alarms(flight)
    assert second.instruction == TAKE_OVER_NOW
    if not limit.home_without or limit.home_s is None:
        flight.fly_for(480.0)
        assert len(alarms(flight)) == pytest.approx(2 + 480.0 / REPEATED_S, abs=1)
        assert all(alarm.instruction == TAKE_OVER_NOW for alarm in alarms(flight)[1:])
        # It holds, and comes home once it can: announced once each.
        assert len(announced(flight, "holding")) <= 1
        missing.comes_again()
        flight.fly_for(10.0)
    else:  # home is flown without it
        flight.fly_for(limit.home_s - limit.stop_s - ESCALATES_S)
    count = len(alarms(flight))
    assert flight.controller.context.alarms.shown == {}
    flight.fly_for(60.0)
    assert len(alarms(flight)) == count, alarms(flight)[count - 1 :]


def test_a_pilot_who_takes_over_is_alerted_no_more(away):
    flight = away(duration_s=None)
    Missing(flight, "position_s")
    flight.fly_for(5.0)
    assert len(alarms(flight)) == 1
    flight.mode, flight.target = FlightMode.ALTITUDE, None
    flight.fly_for(120.0)
    assert flight.controller.state is State.PASSIVE
    assert len(alarms(flight)) == 1


def test_a_fix_that_is_gone_for_long_is_an_alarm(away):
    flight = away(duration_s=None)
    flight.fix = False
    flight.fly_for(FIX_ALARM_S - 1.0)
    assert alarms(flight) == []
    flight.fly_for(2.0)
    (alarm,) = alarms(flight)
    assert (alarm.about, alarm.instruction) == ("GPS has no fix", TAKE_OVER_BLIND)
    flight.fix = True
    flight.fly_for(30.0)
    assert len(alarms(flight)) == 1


def test_the_duration_goes_on_without_positions(away):
    flight = away(duration_s=60.0)
    began_s = flight.now_s
    Missing(flight, "position_s")
    flight.fly_until(lambda: flight.controller.state is State.HOME, 60.0)
    assert flight.controller.context.ending_why in {
        "mission duration (60 s) reached",
        "position not received for 30 s",
    }
    assert flight.now_s - began_s <= 31.0


def test_the_battery_reserve_counts_without_positions(away):
    flight = away(duration_s=None)
    Missing(flight, "position_s")
    flight.fly_for(3.0)
    flight.battery = flight.mission.battery_reserve - 0.01
    flight.fly_for(1.0)
    assert flight.controller.state is State.HOME
    assert announced(flight, "coming home", "battery at")


def test_while_the_flight_mode_is_not_received_nothing_at_all_is_commanded(away):
    flight = away(duration_s=60.0)
    missing = Missing(flight, "mode_s")
    flight.fly_for(5.5)
    commanded = len(flight.motions)
    flight.operator_requests(ComeHome())
    flight.mode, flight.target = FlightMode.OTHER, None  # a pilot took it; it does not show
    flight.fly_for(60.0)
    assert len(flight.motions) == commanded
    missing.comes_again()
    flight.fly_for(5.0)
    assert flight.controller.state is State.PASSIVE
    assert len(flight.motions) == commanded


def test_positions_missing_while_it_lands_do_not_stop_it(airborne):
    flight = airborne(duration_s=60.0)
    flight.fly_to_state(State.LAND)
    commanded = len(flight.motions)
    Missing(flight, "position_s")
    flight.lands()
    assert len(flight.motions) == commanded
    assert announced(flight, "position", "the landing continues")


def test_in_the_climb_it_is_announced_and_the_mission_ends_by_the_same_table(pretend):
    flight = pretend()
    flight.take_off_halfway()
    missing = Missing(flight, "position_s")
    flight.fly_for(3.0)
    assert announced(flight, "position not received")
    flight.fly_for(28.0)
    assert flight.controller.state is State.HOME
    missing.comes_again()
    flight.lands()


def test_what_is_missing_is_announced_also_while_another_flies_it(away):
    flight = away()
    flight.pilot_chooses(FlightMode.OTHER)
    Missing(flight, "position_s")
    flight.fly_for(3.0)
    assert announced(flight, "position not received")
    assert flight.controller.state is State.PASSIVE
